"""Force periodic in position, whatever the input or the direction: cogging."""

from typing import ClassVar

from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.waves import AbstractWave, AbstractWaveWithOvertones, wave_strengths


class Ripple(AbstractWave, AbstractForceEffect):
    """J x'' = km u - F - sine sin(2 pi x/period) - cosine cos(2 pi x/period).

    **Arguments:**

    - `sine`, `cosine`: amplitudes, force units.
    - `period`: position units.
    """

    name: ClassVar[str] = "ripple"
    about: ClassVar[About] = About(
        sentence="a force periodic in position (cogging)",
        equation="J x'' = km u - F - sine sin(2 pi x/period) - cosine cos(2 pi x/period)",
        shows="a wave along the stroke with the same sign in both directions",
        confused_with=("position_dependence", "return_spring", "constant_load"),
        split_by="slow moves over several periods in both directions",
        one_law=True,
        of_position=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths("{force}", "amplitude", scale="Fc")
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "period", "{position}", "period along the stroke", "log", scale="even_period", grid="period"
        ),
    )

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.wave(now.x)


class RippleWithOvertones(AbstractWaveWithOvertones, AbstractForceEffect):
    """J x'' = km u - F - sum of sine_k sin(2 pi k x/period) + cosine_k cos(2 pi k x/period), k = 1 to 4: the pulls of
    slots are short, with level stretches between them.

    **Arguments:**

    - `sine`, `cosine`: amplitudes, force units; those with a number k: at the k-th part of the period.
    - `period`: position units.
    """

    name: ClassVar[str] = Ripple.name
    about: ClassVar[About] = Ripple.about
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths(
        "{force}", "amplitude", scale="Fc", harmonics=4
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = Ripple.nuisances

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.wave(now.x)
