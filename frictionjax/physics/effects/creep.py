"""Presliding displacement that continues under a constant force."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractCreepEffect, Now
from frictionjax.physics.lugre import LuGre

_ABOUT = About(
    sentence="presliding creep: displacement that continues under a constant force",
    equation="d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant, dz/dt = w - |w| F_z/G, w = v - d x_c/dt",
    shows="constant and slow loads below break-away",
    confused_with=("maxwell_slip", "dwell_strengthening", "viscoelastic_damping"),
    split_by="a constant force below break-away for ten seconds, then released",
    source="Rizos, Fassois 2004",
    needs=("presliding",),
)
_STRENGTH = Parameter(
    "compliance", "1", "creep over elastic deflection", lower=0.0, upper=3.0, probes=(0.02, 0.3)
)
_TIME_CONSTANT = Parameter(
    "time_constant", "s", "time constant", "log", lower=0.005, upper=30.0, grid=(0.02, 0.2, 2.0)
)


class _AbstractKelvinVoigt(AbstractCreepEffect):
    """Kelvin-Voigt elements in series: their creep is not deflection of the bristle."""

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        source, rate = self.relax(friction, now)
        return jnp.sum(source - rate * now.hidden)


class _AbstractOutsideContact(_AbstractKelvinVoigt):
    """Elements outside the contact: the bristle slips with its own velocity."""

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.bristle_speed(friction, now)


def _one_element(
    creep: "Creep | CreepingSlip", friction: LuGre, now: Now
) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
    """Source and rate of an element with a time constant."""
    source = creep.compliance * now.spring / (friction.sigma0 * creep.time_constant)
    return source[None], jnp.broadcast_to(1.0 / creep.time_constant, (1,))


class Creep(_AbstractOutsideContact):
    """A Kelvin-Voigt element in series with the bristle: d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant.

    The velocity of the bristle is v - d x_c/dt.

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
    nuisances: ClassVar[tuple[Parameter, ...]] = (_TIME_CONSTANT,)

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return _one_element(self, friction, now)


class CreepingSlip(_AbstractKelvinVoigt):
    """A Kelvin-Voigt element within the bristle: d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant.

    LuGre's law applies to the joint deflection z + x_c of bristle and element: the bristle slips with the whole
    velocity v, also while the element creeps. The creep of `Creep` is outside the contact: there the bristle slips with
    its own velocity, v - d x_c/dt. Near break-away the two differ: here a slow load moves the machine further.

    **Arguments:**

    - `compliance`: final creep over the elastic deflection.
    - `time_constant`: s.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.3)

    states: ClassVar[int] = 1
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = dataclasses.replace(
        _ABOUT,
        equation="d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant, dz/dt = v - d x_c/dt - |v| F_z/G",
        source="Zener 1948 (standard linear solid), in place of the spring of Canudas de Wit et al. 1995",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (_STRENGTH,)
    nuisances: ClassVar[tuple[Parameter, ...]] = (_TIME_CONSTANT,)

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return _one_element(self, friction, now)

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return jnp.zeros(())


class TwoStageCreep(_AbstractOutsideContact):
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


class LogarithmicCreep(_AbstractOutsideContact):
    """Equal Kelvin-Voigt elements in series, one a decade: under a constant force x_c grows with log t.

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
