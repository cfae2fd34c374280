"""Friction that grows with the force that is transmitted, as in gears."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractLevelEffect, Along, Now
from frictionjax.physics.lugre import LuGre


class LoadDependence(AbstractLevelEffect):
    """G -> G + growth |km u|.

    **Arguments:**

    - `growth`: friction per transmitted force.
    """

    growth: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    along: ClassVar[Along] = "input"
    name: ClassVar[str] = "load_dependence"
    about: ClassVar[About] = About(
        sentence="friction that grows with transmitted force",
        equation="G -> G + growth |km u|",
        shows="hard accelerations and loaded moves, compared with the same speed without load",
        confused_with=("nonlinear_bristle", "elasto_plastic", "drive_saturation"),
        split_by="the same slow moves with and without an external load",
        source="Hamon, Gautier, Janot 2010; Duclusaud, Passault et al. 2024",
        needs=("motor force",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("growth", "1", "friction per transmitted force", lower=0.0, upper=0.9, probes=(0.01, 0.15)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level + self.growth * jnp.abs(now.push)
