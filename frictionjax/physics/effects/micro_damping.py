"""Damping of the bristles that falls with velocity."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractDampingEffect
from frictionjax.physics.lugre import LuGre


class MicroDamping(AbstractDampingEffect):
    """sigma1 -> sigma1 (1 - fall (1 - exp(-(v/speed)^2))).

    **Arguments:**

    - `fall`: part of sigma1 that is lost in fast sliding.
    - `speed`: velocity at which it is lost, position/s.
    """

    fall: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    speed: Float[Array, "..."] = eqx.field(converter=real, default=1e-3)

    name: ClassVar[str] = "micro_damping"
    about: ClassVar[About] = About(
        sentence="bristle damping that falls with velocity",
        equation="sigma1 -> sigma1 (1 - fall (1 - exp(-(v/speed)^2)))",
        shows="the first instants after break-away and after reversals",
        confused_with=("delay", "drive_lag"),
        split_by="sudden break-away and reversals at several accelerations, besides presliding noise",
        source="Olsson 1996",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("fall", "1", "part of sigma1 lost", lower=0.0, upper=1.0, probes=(0.1, 0.8)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("speed", "{position}/s", "velocity where it is lost", "log", scale="vs", grid=(0.3, 3.0)),
    )

    def damping(self, friction: LuGre, v: Float[Array, ""]) -> Float[Array, ""]:
        ratio = v / self.speed
        return 1.0 + self.fall * jnp.expm1(-ratio * ratio)
