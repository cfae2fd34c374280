"""Unbalance of a rotary axis: gravity on an eccentric mass."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Along, Now
from frictionjax.physics.lugre import LuGre


class GravityPendulum(AbstractForceEffect):
    """J x'' = km u - F - sine sin(x) - cosine cos(x), for a position in rad: m g l sin(x + x0).

    **Arguments:**

    - `sine`, `cosine`: parts of the gravity torque, force units.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    along: ClassVar[Along] = "position"
    name: ClassVar[str] = "gravity_pendulum"
    about: ClassVar[About] = About(
        sentence="unbalance: the torque of gravity on an eccentric mass",
        equation="J x'' = km u - F - sine sin(x) - cosine cos(x), x in rad",
        shows="a wave of one turn with the same sign in both directions",
        confused_with=("return_spring", "constant_load", "ripple"),
        split_by="slow moves over a whole turn in both directions",
        needs=("angle",),
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine", "{force}", "torque a quarter turn from x = 0", scale="Fc", probes=(0.02,)),
        Parameter("cosine", "{force}", "torque at x = 0", scale="Fc", probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.sine * jnp.sin(now.x) + self.cosine * jnp.cos(now.x)
