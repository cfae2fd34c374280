"""Periodic error of the position sensor: sub-divisional error of an interpolated encoder, eccentricity."""

from typing import ClassVar

from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.physics.effects.base import About, AbstractSensorEffect
from frictionjax.physics.waves import AbstractWave, AbstractWaveWithOvertone, wave_strengths


class EncoderError(AbstractWave, AbstractSensorEffect):
    """x -> x + sine sin(2 pi x/period) + cosine cos(2 pi x/period) is measured.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, position units.
    - `period`: position units.
    """

    name: ClassVar[str] = "encoder_error"
    about: ClassVar[About] = About(
        sentence="a periodic error of the position measurement (interpolation, eccentricity)",
        equation="x -> x + sine sin(2 pi x/period) + cosine cos(2 pi x/period) is measured",
        shows="a wave of constant height in position: as a force it grows with the square of speed",
        confused_with=("ripple", "torque_ripple"),
        split_by="the same stroke at two speeds: an error of position stays, a force weighs less when fast",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths(
        "{position}", "amplitude", scale="step", probe=1.0
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("period", "{position}", "period of the error", "log", scale="sensor_period", grid="period"),
    )

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        return position + self.wave(position)


class EncoderErrorWithOvertone(AbstractWaveWithOvertone, AbstractSensorEffect):
    """x -> x + sum of sine_k sin(2 pi k x/period) + cosine_k cos(2 pi k x/period), k = 1, 2, is measured: offsets and
    unequal amplitudes of the two signals that are interpolated make one wave each.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, position units; `sine2`, `cosine2`: those at half the period.
    - `period`: position units.
    """

    name: ClassVar[str] = EncoderError.name
    about: ClassVar[About] = EncoderError.about
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths(
        "{position}", "amplitude", scale="step", probe=1.0, harmonics=2
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = EncoderError.nuisances

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        return position + self.wave(position)
