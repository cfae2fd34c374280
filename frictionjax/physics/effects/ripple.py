"""Force periodic in position, whatever the input or the direction: cogging."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.waves import wave


class Ripple(AbstractForceEffect):
    """J x'' = km u - F - sine sin(2 pi x/period) - cosine cos(2 pi x/period).

    **Arguments:**

    - `sine`, `cosine`: amplitudes, force units.
    - `period`: position units.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = "ripple"
    about: ClassVar[About] = About(
        sentence="a force periodic in position (cogging)",
        equation="J x'' = km u - F - sine sin(2 pi x/period) - cosine cos(2 pi x/period)",
        shows="a wave along the stroke with the same sign in both directions",
        confused_with=("position_dependence", "return_spring"),
        split_by="slow moves over several periods in both directions",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine", "{force}", "sine amplitude", scale="Fc", probes=(0.02,)),
        Parameter("cosine", "{force}", "cosine amplitude", scale="Fc", probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "period", "{position}", "period along the stroke", "log", scale="even_period", grid="period"
        ),
    )

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return wave(now.x / self.period, (self.sine, self.cosine))


class RippleWithOvertone(AbstractForceEffect):
    """J x'' = km u - F - sum of sine_k sin(2 pi k x/period) + cosine_k cos(2 pi k x/period), k = 1, 2: a wave with an
    overtone.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, force units; `sine2`, `cosine2`: those at half the period.
    - `period`: position units.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = Ripple.name
    about: ClassVar[About] = Ripple.about
    strengths: ClassVar[tuple[Parameter, ...]] = (
        *Ripple.strengths,
        Parameter("sine2", "{force}", "sine amplitude at half the period", scale="Fc", probes=(0.02,)),
        Parameter("cosine2", "{force}", "cosine amplitude at half the period", scale="Fc", probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = Ripple.nuisances

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return wave(now.x / self.period, (self.sine, self.cosine), (self.sine2, self.cosine2))
