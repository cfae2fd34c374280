"""Friction level that varies along the stroke: smoothly (polynomial) or periodically (screw lead, mesh)."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractLevelEffect, Along, Now
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.waves import AbstractWave, wave_strengths

_ABOUT = About(
    sentence="friction whose level varies along the stroke",
    equation="G -> G (1 + shape(x))",
    shows="a force that opposes motion in both directions at the same place",
    confused_with=("ripple",),
    split_by="slow moves over the same stroke in both directions",
)


class PositionDependence(AbstractLevelEffect):
    """G -> G (1 + linear p + quadratic (3 p^2 - 1)/2) with p = (x - center)/half_stroke (Legendre polynomials).

    **Arguments:**

    - `linear`, `quadratic`: relative change of the level along the stroke.
    - `center`, `half_stroke`: the stroke of the recordings, position units (not fitted).
    """

    linear: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    quadratic: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    center: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    half_stroke: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    along: ClassVar[Along] = "position"
    name: ClassVar[str] = "position_dependence"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("linear", "1", "linear change over half the stroke", lower=-0.9, upper=0.9, probes=(0.02,)),
        Parameter("quadratic", "1", "curved change", lower=-0.9, upper=0.9, probes=(0.02,)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("center", "{position}", "middle of the stroke", "none", scale="center", grid=(1.0,)),
        Parameter("half_stroke", "{position}", "half the stroke", "none", scale="stroke", grid=(0.5,)),
    )

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        # Outside the stroke the polynomial would diverge; a friction level does not.
        p = jnp.clip((now.x - self.center) / self.half_stroke, -1.2, 1.2)
        return level * (1.0 + self.linear * p + self.quadratic * (1.5 * p * p - 0.5))


class PeriodicPositionDependence(AbstractWave, AbstractLevelEffect):
    """G -> G (1 + sine sin(2 pi x/period) + cosine cos(2 pi x/period)).

    **Arguments:**

    - `sine`, `cosine`: relative change of the level.
    - `period`: position units.
    """

    name: ClassVar[str] = "position_dependence"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = wave_strengths("1", "part", limit=0.9)
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "period", "{position}", "period along the stroke", "log", scale="odd_period", grid="period"
        ),
    )

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * (1.0 + self.wave(now.x))
