"""Friction that falls with the measured temperature."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import (
    TEMPERATURES,
    About,
    AbstractLevelEffect,
    AbstractStateEffect,
    Along,
    Before,
    Now,
)
from frictionjax.physics.lugre import LuGre

_LEAST = 0.1  # of the denominator: a level may rise tenfold


class WarmupByTemperature(AbstractStateEffect, AbstractLevelEffect):
    """G -> G/(1 + fall (T - T0)), T the measured temperature, T0 that of the first sample of the first recording.

    The states contain the recorded temperature: the elapsed part of the recording, its rate, and T - T0 at
    `TEMPERATURES` equidistant instants, between which T is a straight line.

    **Arguments:**

    - `fall`: relative fall of the level per kelvin, to first order.
    """

    fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    states: ClassVar[int] = 2 + TEMPERATURES
    along: ClassVar[Along] = "time"
    name: ClassVar[str] = "warmup"
    about: ClassVar[About] = About(
        sentence="friction that falls with the measured temperature (warm-up)",
        equation="G -> G/(1 + fall (T - T0)), T measured",
        shows="the same motion with less friction where the sensor shows a higher temperature",
        confused_with=("position_dependence", "load_dependence"),
        split_by="the same move at two temperatures that heating from outside sets",
        source="Bittencourt, Gunnarsson 2012; Simoni et al. 2015",
        needs=("temperature", "sliding"),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "fall", "1/K", "relative fall of the level per kelvin", lower=-0.05, upper=1.0, probes=(2e-3,)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        still = jnp.zeros(self.states)
        return still.at[0].set(now.hidden[1]), still

    def initial_states(self, friction: LuGre, before: Before) -> Float[Array, " states"]:
        return jnp.concatenate([jnp.zeros(1), 1.0 / before.duration[None], before.temperature])

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        warmer = jnp.interp(now.hidden[0], jnp.linspace(0.0, 1.0, TEMPERATURES), now.hidden[2:])
        return level / jnp.maximum(1.0 + self.fall * warmer, _LEAST)
