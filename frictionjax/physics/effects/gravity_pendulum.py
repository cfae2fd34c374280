"""Unbalance of a rotary axis: gravity on an eccentric mass."""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Along, Now
from frictionjax.physics.lugre import LuGre


class GravityPendulum(AbstractForceEffect):
    """J x'' = km u - F - sine sin(a) - cosine cos(a), a = 2 pi x/turn: m g l sin(a + a0).

    **Arguments:**

    - `sine`, `cosine`: parts of the gravity torque, force units.
    - `turn`: a full turn, position units: 2 pi for a position in rad, 360 for one in deg. It is not fitted.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    turn: Float[Array, "..."] = eqx.field(converter=real, default=2.0 * math.pi)

    along: ClassVar[Along] = "position"
    name: ClassVar[str] = "gravity_pendulum"
    about: ClassVar[About] = About(
        sentence="unbalance: the torque of gravity on an eccentric mass",
        equation="J x'' = km u - F - sine sin(a) - cosine cos(a), a = 2 pi x/turn",
        shows="a wave of one turn with the same sign in both directions",
        confused_with=("return_spring", "constant_load", "ripple"),
        split_by="slow moves over a whole turn in both directions",
        needs=("angle",),
        one_law=True,
        of_position=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine", "{force}", "torque a quarter turn from x = 0", scale="Fc", probes=(0.02,)),
        Parameter("cosine", "{force}", "torque at x = 0", scale="Fc", probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        angle = now.x * (2.0 * jnp.pi / self.turn)
        return self.sine * jnp.sin(angle) + self.cosine * jnp.cos(angle)
