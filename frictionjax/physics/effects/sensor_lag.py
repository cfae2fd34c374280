"""Lag of the position measurement: an anti-alias filter, a slow sensor."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSensorEffect, AbstractStateEffect, Now
from frictionjax.physics.lugre import LuGre

# s, added to the lag, so that the derivative stays finite at zero lag.
_INSTANT = 1e-20


class SensorLag(AbstractSensorEffect, AbstractStateEffect):
    """y of lag y' = x - y is measured: the lag error h = x - y follows h' = v - h/lag.

    **Arguments:**

    - `lag`: s, not negative.
    """

    lag: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "sensor_lag"
    about: ClassVar[About] = About(
        sentence="a position measurement that lags",
        equation="y of lag y' = x - y is measured",
        shows="fast motion: the position seems to lag the input",
        confused_with=("delay", "drive_lag"),
        split_by="a measured force besides the position, or a closed loop: only the sensor's lag is fed back",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lag", "s", "time constant of the measurement", scale="dt", lower=0.0, probes=(0.1, 1.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()
    states: ClassVar[int] = 1

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return now.v[None], (1.0 / (self.lag + _INSTANT))[None] + jnp.zeros(1)

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        return position - hidden[0]
