"""Friction that falls as the machine warms up, by time since power-on or by heat of motion."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import (
    About,
    AbstractForceEffect,
    AbstractLevelEffect,
    AbstractStateEffect,
    Along,
    Before,
    Now,
)
from frictionjax.physics.lugre import LuGre

_SHOWS = "the same motion in later recordings, or late in a long one, with less friction"
_CONFUSED = ("position_dependence", "load_dependence")
_SPLIT = "the same move repeated until friction stays, then a pause, then again"
_SOURCE = "Bittencourt, Gunnarsson 2012; Simoni et al. 2015; Wolf, Iskandar 2018"
_NEEDS = ("clock", "sliding")
_TIME = Parameter(
    "time_constant",
    "s",
    "time constant of the warm-up",
    "log",
    lower=1.0,
    upper=1e4,
    grid=(15.0, 60.0, 200.0),
)
_LEAST = 0.1  # of the level: friction never becomes negative


class WarmupByTime(AbstractStateEffect, AbstractLevelEffect, AbstractForceEffect):
    """G -> G (1 - fall T), sigma2 -> sigma2 (1 - viscous_fall T) with dT/dt = (1 - T)/time_constant since power-on.

    **Arguments:**

    - `fall`, `viscous_fall`: final relative fall of the level and of the viscous part.
    - `time_constant`: s.
    """

    fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    viscous_fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=60.0)

    states: ClassVar[int] = 1
    along: ClassVar[Along] = "time"
    name: ClassVar[str] = "warmup"
    about: ClassVar[About] = About(
        sentence="friction that falls with running time (warm-up)",
        equation="G -> G (1 - fall T), sigma2 -> sigma2 (1 - viscous_fall T), T = 1 - exp(-clock/time_constant)",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
        source=_SOURCE,
        needs=_NEEDS,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("fall", "1", "relative fall of the level", lower=-0.5, upper=0.9, probes=(0.02,)),
        Parameter(
            "viscous_fall",
            "1",
            "relative fall of the viscous part",
            lower=-0.5,
            upper=0.95,
            probes=(0.02,),
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (_TIME,)

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        rate = (1.0 / self.time_constant)[None]
        return rate, rate

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        return -jnp.expm1(-before.clock / self.time_constant)[None]

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * (1.0 - self.fall * now.hidden[0])

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return -self.viscous_fall * now.hidden[0] * friction.sigma2 * now.v


class WarmupByHeat(AbstractStateEffect, AbstractLevelEffect, AbstractForceEffect):
    """G -> G (1 - fall T), sigma2 -> sigma2 exp(-viscous_fall T) with dT/dt = |v|/distance - T/time_constant: motion
    heats, time cools. A tenth of the level remains at any heat.

    **Arguments:**

    - `fall`, `viscous_fall`: relative fall of the level and of the viscous part when T is 1, to first order.
    - `time_constant`: of cooling, s.
    - `distance`: path that makes T = 1 when nothing cools, position units (not fitted).
    """

    fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    viscous_fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=60.0)
    distance: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    states: ClassVar[int] = 1
    along: ClassVar[Along] = "time"
    name: ClassVar[str] = "warmup"
    about: ClassVar[About] = About(
        sentence="friction that falls with the heat of motion (warm-up)",
        equation="G -> G (1 - fall T), sigma2 -> sigma2 exp(-viscous_fall T), dT/dt = |v|/distance - T/time_constant",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
        source=_SOURCE,
        needs=_NEEDS,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("fall", "1", "relative fall of the level at T = 1", lower=-0.1, upper=10.0, probes=(0.02,)),
        Parameter(
            "viscous_fall", "1", "relative fall of the viscous part", lower=-0.1, upper=10.0, probes=(0.02,)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        _TIME,
        Parameter("distance", "{position}", "path that warms by 1", "none", scale="stroke", grid=(10.0,)),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return (jnp.abs(now.v) / self.distance)[None], (1.0 / self.time_constant)[None]

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        left = before.path * jnp.exp(-before.age / self.time_constant)
        return (jnp.sum(left) / self.distance)[None]

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * jnp.maximum(1.0 - self.fall * now.hidden[0], _LEAST)

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return jnp.expm1(-self.viscous_fall * now.hidden[0]) * friction.sigma2 * now.v
