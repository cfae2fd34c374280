"""Stribeck exponent other than 2."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import power, real
from frictionjax.physics.effects.base import About, AbstractLevelEffect, Now
from frictionjax.physics.lugre import LuGre


class StribeckShape(AbstractLevelEffect):
    """G(v) = Fc + (Fs - Fc) exp(-|v/vs|^(2 + exponent_change)); -1 gives Tustin's exponential.

    **Arguments:**

    - `exponent_change`: exponent minus 2.
    """

    exponent_change: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "stribeck_shape"
    about: ClassVar[About] = About(
        sentence="a Stribeck curve of another shape (exponent other than 2)",
        equation="G(v) = Fc + (Fs - Fc) exp(-|v/vs|^(2 + exponent_change))",
        shows="sliding at speeds around the Stribeck velocity, alike in both directions",
        confused_with=(),
        split_by="slow constant-velocity moves from a tenth to ten times vs",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "exponent_change", "1", "exponent minus 2", lower=-1.8, upper=4.0, probes=(-0.05, -0.7, 0.7)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        ratio = jnp.abs(now.v) / friction.vs
        squared = ratio * ratio
        # |v/vs|^(2+d) = (v/vs)^2 |v/vs|^d; written so that the derivative in d at v = 0 is 0, not NaN.
        shaped = power(ratio, 2.0 + self.exponent_change)
        return level + (friction.Fs - friction.Fc) * (jnp.exp(-shaped) - jnp.exp(-squared))
