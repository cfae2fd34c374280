"""Presliding creep of a bristle that slips as fast as the machine moves, creep included."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractCreepEffect, Now
from frictionjax.physics.lugre import LuGre


class CreepingSlip(AbstractCreepEffect):
    """A Kelvin-Voigt element within the bristle: d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant.

    LuGre's law holds for what bristle and element bend together, z + x_c: it slips with the whole velocity v, also
    while it is the element that moves. The creep of `Creep` is beside the contact: there the bristle slips with what it
    sees itself, v - d x_c/dt. Near break-away the two differ: here a slow load moves the machine further.

    **Arguments:**

    - `compliance`: final creep over the elastic deflection.
    - `time_constant`: s.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.3)

    states: ClassVar[int] = 1
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = About(
        sentence="presliding creep: displacement that goes on under a constant force",
        equation="d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant, dz/dt = v - d x_c/dt - |v| F_z/G",
        shows="holds and slow loads below break-away",
        confused_with=("maxwell_slip", "dwell_strengthening", "viscoelastic_damping"),
        split_by="a force held below break-away for ten seconds, and let go",
        source="Zener 1948 (standard linear solid), in place of the spring of Canudas de Wit et al. 1995",
        needs=("presliding",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "compliance", "1", "creep over elastic deflection", lower=0.0, upper=3.0, probes=(0.02, 0.3)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "time_constant", "s", "time constant", "log", lower=0.005, upper=30.0, grid=(0.02, 0.2, 2.0)
        ),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        source = self.compliance * now.spring / (friction.sigma0 * self.time_constant)
        return source[None], jnp.broadcast_to(1.0 / self.time_constant, (1,))

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        source, rate = self.relax(friction, now)
        return source[0] - rate[0] * now.hidden[0]

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return jnp.zeros(())
