"""Motor constant that is periodic in position: torque ripple."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.waves import wave


class TorqueRipple(AbstractForceEffect):
    """J x'' = km u (1 + sine sin(2 pi x/period) + cosine cos(2 pi x/period)) - F.

    **Arguments:**

    - `sine`, `cosine`: relative change of the motor constant.
    - `period`: position units.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = "torque_ripple"
    about: ClassVar[About] = About(
        sentence="a motor constant periodic in position (torque ripple)",
        equation="J x'' = km u (1 + sine sin(2 pi x/period) + cosine cos(2 pi x/period)) - F",
        shows="a wave along the stroke that grows with the input",
        confused_with=("ripple", "position_dependence", "warmup"),
        split_by="moves over several periods with different accelerations: it grows with the input, not with friction",
        needs=("motor force",),
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sine", "1", "sine part", lower=-0.9, upper=0.9, probes=(0.02,)),
        Parameter("cosine", "1", "cosine part", lower=-0.9, upper=0.9, probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "period", "{position}", "period along the stroke", "log", scale="even_period", grid="period"
        ),
    )

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return -now.push * wave(now.x / self.period, (self.sine, self.cosine))


class TorqueRippleWithOvertone(AbstractForceEffect):
    """J x'' = km u (1 + sum of sine_k sin(2 pi k x/period) + cosine_k cos(2 pi k x/period)) - F, k = 1, 2: a wave with
    an overtone.

    **Arguments:**

    - `sine`, `cosine`: relative change of the motor constant; `sine2`, `cosine2`: that at half the period.
    - `period`: position units.
    """

    sine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    cosine2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    period: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = TorqueRipple.name
    about: ClassVar[About] = TorqueRipple.about
    strengths: ClassVar[tuple[Parameter, ...]] = (
        *TorqueRipple.strengths,
        Parameter("sine2", "1", "sine part at half the period", lower=-0.9, upper=0.9, probes=(0.02,)),
        Parameter("cosine2", "1", "cosine part at half the period", lower=-0.9, upper=0.9, probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = TorqueRipple.nuisances

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return -now.push * wave(now.x / self.period, (self.sine, self.cosine), (self.sine2, self.cosine2))
