"""Mains frequency in the position signal."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSensorEffect
from frictionjax.physics.waves import wave, wave_strengths


class MainsPickup(AbstractSensorEffect):
    """x + sum of sine_k sin(2 pi k frequency t) + cosine_k cos(2 pi k frequency t) is measured, k = 1 to 3: rectifiers
    add the second harmonic, transformers the third.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, position units; those with a number k: at k times the frequency.
    - `frequency`: Hz (not fitted).
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine3: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine3: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    frequency: Float[Array, "..."] = eqx.field(converter=real, default=50.0)

    name: ClassVar[str] = "mains_pickup"
    about: ClassVar[About] = About(
        sentence="mains frequency in the position signal",
        equation=(
            "x + sum of sine_k sin(2 pi k frequency t) + cosine_k cos(2 pi k frequency t) is measured, k = 1 to 3"
        ),
        shows="lines at 50 or 60 Hz and multiples, also at rest and whatever the input",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths(
        "{position}", "amplitude", scale="step", probe=1.0, harmonics=3
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency", "Hz", "mains frequency", "none", grid=(50.0, 60.0)),
    )

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        first, second = (self.sine, self.cosine), (self.sine2, self.cosine2)
        return position + wave(self.frequency * t, first, second, (self.sine3, self.cosine3))
