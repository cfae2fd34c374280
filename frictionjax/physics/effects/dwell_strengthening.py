"""Static friction that grows with time at rest: ageing of contacts."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import (
    About,
    AbstractLevelEffect,
    AbstractStateEffect,
    Along,
    Before,
    Now,
)
from frictionjax.physics.lugre import LuGre

# Contacts that age faster than this are as old at every rest, and in sliding make a Stribeck curve: another effect.
_SHORTEST = 0.01  # s
_CONFUSED = ("stribeck_shape", "nonlinear_bristle", "creep")
_SHOWS = "break-away after rests of different length"
_SPLIT = "the same break-away ramp after rests of 0.1, 1 and 10 s"


def _slip(friction: LuGre, now: Now) -> Float[Array, ""]:
    """Velocity at which the contacts slip: LuGre's |v| |F_z|/G(v). A bristle that only deflects keeps its contact."""
    return jnp.abs(now.v) * jnp.minimum(jnp.abs(now.spring) / friction.level(now.v), 1.0)


class DwellStrengthening(AbstractStateEffect, AbstractLevelEffect):
    """G -> G + growth Fc log(1 + theta/onset) with the age of contacts dtheta/dt = 1 - v_s theta/length, v_s
    = |v| |F_z|/G(v) the velocity at which they slip.

    **Arguments:**

    - `growth`: rise per e-fold of age, over `Fc`.
    - `onset`: age from which the rise is logarithmic, s.
    - `length`: path that renews the contacts, position units.
    """

    growth: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    onset: Float[Array, "..."] = eqx.field(converter=real, default=0.1)
    length: Float[Array, "..."] = eqx.field(converter=real, default=1e-5)

    states: ClassVar[int] = 1
    along: ClassVar[Along] = "dwell"
    name: ClassVar[str] = "dwell_strengthening"
    about: ClassVar[About] = About(
        sentence="static friction that grows with the logarithm of time at rest",
        equation="G -> G + growth Fc log(1 + theta/onset), dtheta/dt = 1 - v_s theta/length",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
        source="Dieterich 1979; Ruina 1983; Rabinowicz 1958",
        needs=("rest",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "growth",
            "1",
            "rise per e-fold of rest, over Fc",
            lower=0.0,
            upper=0.3,
            probes=(0.005, 0.05),
            # A base fit without this effect absorbs the growth in Fs and in a narrow Stribeck curve.
            other_start=0.05,
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "onset",
            "s",
            "age where the growth sets in",
            "log",
            lower=_SHORTEST,
            upper=100.0,
            grid=(0.01, 0.1, 1.0),
        ),
        Parameter("length", "{position}", "path that renews the contacts", "log", scale="zs", grid=(1.0,)),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return jnp.ones(1), (_slip(friction, now) / self.length)[None]

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        return before.rest[None]

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level + self.growth * friction.Fc * jnp.log1p(now.hidden[0] / self.onset)


class SaturatingStrengthening(AbstractStateEffect, AbstractLevelEffect):
    """G -> G + growth Fc (1 - exp(-theta/time)), dtheta/dt = 1 - v_s theta sigma0/Fs, v_s = |v| |F_z|/G(v).

    **Arguments:**

    - `growth`: rise after a long rest, over `Fc`.
    - `time`: time constant of the rise, s.
    """

    growth: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time: Float[Array, "..."] = eqx.field(converter=real, default=0.3)

    states: ClassVar[int] = 1
    along: ClassVar[Along] = "dwell"
    name: ClassVar[str] = "dwell_strengthening"
    about: ClassVar[About] = About(
        sentence="static friction that grows with time at rest up to a limit",
        equation="G -> G + growth Fc (1 - exp(-theta/time)), dtheta/dt = 1 - v_s theta sigma0/Fs",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
        needs=("rest",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "growth",
            "1",
            "rise after a long rest, over Fc",
            lower=0.0,
            upper=2.0,
            probes=(0.01, 0.15),
            other_start=0.15,
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("time", "s", "time constant", "log", lower=_SHORTEST, upper=100.0, grid=(0.1, 1.0)),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return jnp.ones(1), (_slip(friction, now) * friction.sigma0 / friction.Fs)[None]

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        return before.rest[None]

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level - self.growth * friction.Fc * jnp.expm1(-now.hidden[0] / self.time)
