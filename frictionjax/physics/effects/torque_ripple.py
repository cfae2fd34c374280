"""Motor constant that is periodic in position: torque ripple."""

from typing import ClassVar

from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.waves import AbstractWave, AbstractWaveWithOvertone, wave_strengths


class TorqueRipple(AbstractWave, AbstractForceEffect):
    """J x'' = km u (1 + sine sin(2 pi x/period) + cosine cos(2 pi x/period)) - F.

    **Arguments:**

    - `sine`, `cosine`: relative change of the motor constant.
    - `period`: position units.
    """

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
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths("1", "part", limit=0.9)
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "period", "{position}", "period along the stroke", "log", scale="even_period", grid="period"
        ),
    )

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return -now.push * self.wave(now.x)


class TorqueRippleWithOvertone(AbstractWaveWithOvertone, AbstractForceEffect):
    """J x'' = km u (1 + sum of sine_k sin(2 pi k x/period) + cosine_k cos(2 pi k x/period)) - F, k = 1, 2: a wave with
    an overtone.

    **Arguments:**

    - `sine`, `cosine`: relative change of the motor constant; `sine2`, `cosine2`: that at half the period.
    - `period`: position units.
    """

    name: ClassVar[str] = TorqueRipple.name
    about: ClassVar[About] = TorqueRipple.about
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths("1", "part", limit=0.9, harmonics=2)
    nuisances: ClassVar[tuple[Parameter, ...]] = TorqueRipple.nuisances

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return -now.push * self.wave(now.x)
