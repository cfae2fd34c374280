"""Lag of the position measurement: an anti-alias filter, a slow sensor."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSensorEffect


class SensorLag(AbstractSensorEffect):
    """x - lag v is measured: a lag or a delay that is short against the motion.

    **Arguments:**

    - `lag`: s, not negative.
    """

    lag: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "sensor_lag"
    about: ClassVar[About] = About(
        sentence="a position measurement that comes late",
        equation="x - lag v is measured",
        shows="fast motion: the position seems late behind the input",
        confused_with=("delay", "drive_lag"),
        split_by="a force measured beside the position, or a closed loop: only the sensor's lag is fed back",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lag", "s", "lag of the measurement", scale="dt", lower=0.0, probes=(0.1, 1.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def seen(self, position: Float[Array, ""], v: Float[Array, ""], t: Float[Array, ""]) -> Float[Array, ""]:
        return position - self.lag * v
