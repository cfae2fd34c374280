"""Mains frequency in the position signal."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSensorEffect
from frictionjax.physics.waves import wave, wave_strengths


class MainsPickup(AbstractSensorEffect):
    """x + sine sin(2 pi frequency t) + cosine cos(2 pi frequency t) is measured.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, position units.
    - `frequency`: Hz (not fitted).
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    frequency: Float[Array, "..."] = eqx.field(converter=real, default=50.0)

    name: ClassVar[str] = "mains_pickup"
    about: ClassVar[About] = About(
        sentence="mains frequency in the position signal",
        equation="x + sine sin(2 pi frequency t) + cosine cos(2 pi frequency t) is measured",
        shows="a line at 50 or 60 Hz, also at rest and whatever the input",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths(
        "{position}", "amplitude", scale="step", probe=1.0
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency", "Hz", "mains frequency", "none", grid=(50.0, 60.0)),
    )

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        return position + wave(self.frequency * t, (self.sine, self.cosine))
