"""The offset of a velocity sensor, where only the velocity was recorded and the position is its integral.

An effect like any other, but not in the catalogue: it belongs to the base model of such recordings.
"""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSensorEffect


class VelocityOffset(AbstractSensorEffect):
    """The integral of v + offset is measured: x + offset t, t s after the first sample.

    **Arguments:**

    - `offset`: position units per s.
    """

    offset: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "velocity_offset"
    about: ClassVar[About] = About(
        sentence="an offset of the velocity sensor",
        equation="x + offset t is measured, the integral of v + offset",
        shows="the integrated velocity drifts at a constant rate, also at rest",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("offset", "{position}/s", "offset of the velocity sensor", scale="vs", probes=(0.1,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def measured(
        self, position: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " states"]
    ) -> Float[Array, ""]:
        return position + self.offset * t
