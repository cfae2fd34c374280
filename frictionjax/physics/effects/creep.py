"""Presliding displacement that goes on under a constant force."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractCreepEffect, Now
from frictionjax.physics.lugre import LuGre

_ABOUT = About(
    sentence="presliding creep: displacement that goes on under a constant force",
    equation="d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant, dz/dt = w - |w| F_z/G, w = v - d x_c/dt",
    shows="holds and slow loads below break-away",
    confused_with=("maxwell_slip", "dwell_strengthening", "viscoelastic_damping"),
    split_by="a force held below break-away for ten seconds, and let go",
    source="Rizos, Fassois 2004",
    needs=("presliding",),
)
_STRENGTH = Parameter(
    "compliance", "1", "creep over elastic deflection", lower=0.0, upper=3.0, probes=(0.02, 0.3)
)


class Creep(AbstractCreepEffect):
    """A Kelvin-Voigt element in series with the bristle: d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant.

    The bristle sees v - d x_c/dt.

    **Arguments:**

    - `compliance`: final creep over the elastic deflection.
    - `time_constant`: s.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.3)

    states: ClassVar[int] = 1
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (_STRENGTH,)
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
        return self.bristle_speed(friction, now)


class TwoStageCreep(AbstractCreepEffect):
    """Two Kelvin-Voigt elements in series with the bristle, a fast and a slow one.

    **Arguments:**

    - `compliance`: final creep of both over the elastic deflection.
    - `time_constant`: of the fast one, s.
    - `ratio`: of the slow time constant to the fast one.
    - `slow_part`: of the compliance, in the slow element.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.05)
    ratio: Float[Array, "..."] = eqx.field(converter=real, default=10.0)
    slow_part: Float[Array, "..."] = eqx.field(converter=real, default=0.5)

    states: ClassVar[int] = 2
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (_STRENGTH,)
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "time_constant", "s", "fast time constant", "log", lower=0.005, upper=10.0, grid=(0.02, 0.2)
        ),
        Parameter("ratio", "1", "slow over fast time constant", "log", lower=1.5, upper=300.0, grid=(10.0,)),
        Parameter("slow_part", "1", "part of the slow element", "log", lower=0.02, upper=0.98, grid=(0.5,)),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        rate = 1.0 / (self.time_constant * jnp.stack([jnp.ones_like(self.ratio), self.ratio]))
        part = jnp.stack([1.0 - self.slow_part, self.slow_part])
        return self.compliance * now.spring / friction.sigma0 * part * rate, rate

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        source, rate = self.relax(friction, now)
        return jnp.sum(source - rate * now.hidden)

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.bristle_speed(friction, now)


class LogarithmicCreep(AbstractCreepEffect):
    """Kelvin-Voigt elements in series, one a decade and alike: under a constant force x_c grows with log t.

    From `shortest` to a thousand times as long the growth per decade is `compliance` F_z/sigma0.

    **Arguments:**

    - `compliance`: creep of a decade over the elastic deflection.
    - `shortest`: time constant of the fastest element, s.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    shortest: Float[Array, "..."] = eqx.field(converter=real, default=0.01)

    states: ClassVar[int] = 4
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (_STRENGTH,)
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("shortest", "s", "shortest time constant", "log", lower=0.002, upper=1.0, grid=(0.02,)),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        rate = 1.0 / (self.shortest * 10.0 ** jnp.arange(4.0))
        return self.compliance * now.spring / friction.sigma0 * rate, rate

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        source, rate = self.relax(friction, now)
        return jnp.sum(source - rate * now.hidden)

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.bristle_speed(friction, now)
