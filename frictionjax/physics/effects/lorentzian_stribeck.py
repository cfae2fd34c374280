"""Stribeck curve with the long tail of a Lorentzian."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractLevelEffect, Now
from frictionjax.physics.lugre import LuGre


class LorentzianStribeck(AbstractLevelEffect):
    """G(v) = Fc + (Fs - Fc) ((1 - blend) exp(-(v/vs)^2) + blend/(1 + (v/vs)^2)).

    **Arguments:**

    - `blend`: from the Gaussian (0) to the Lorentzian (1).
    """

    blend: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "stribeck_shape"
    about: ClassVar[About] = About(
        sentence="a Stribeck curve of another shape (the long tail of a Lorentzian)",
        equation="G(v) = Fc + (Fs - Fc) ((1 - blend) exp(-(v/vs)^2) + blend/(1 + (v/vs)^2))",
        shows="sliding at speeds around and above the Stribeck velocity, alike in both directions",
        confused_with=(),
        split_by="slow constant-velocity moves from a tenth to ten times vs",
        source="Hess, Soom 1990; Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("blend", "1", "from Gaussian to Lorentzian", lower=-0.5, upper=1.5, probes=(0.05, 1.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        ratio = now.v / friction.vs
        squared = ratio * ratio
        tail = 1.0 / (1.0 + squared) - jnp.exp(-squared)
        return level + (friction.Fs - friction.Fc) * self.blend * tail
