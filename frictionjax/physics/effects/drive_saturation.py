"""Drive gain that falls with the amplitude of the input: gradually, or at a limit."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractInputEffect

_SHOWS = "the largest inputs, whatever the motion"
_CONFUSED = ("nonlinear_bristle", "load_dependence")
_SPLIT = "large inputs in free acceleration, or the same inputs with another inertia"
_CUT = Parameter("cut", "1", "part of the largest input cut off", lower=0.0, upper=0.95, probes=(0.1, 0.4))
_LARGEST = Parameter("largest", "{input}", "largest input", "none", scale="u", grid=(1.0,))


class SoftSaturation(AbstractInputEffect):
    """u -> u/(1 + k (|u|/largest)^sharpness)^(1/sharpness), k = (1 - cut)^-sharpness - 1: an amplifier's soft limit
    (Rapp 1991), largest/k^(1/sharpness). Drives differ in the sharpness of the bend.

    **Arguments:**

    - `cut`: part of the largest input that has no effect.
    - `sharpness`: of the bend; a high one comes near a hard limit.
    - `largest`: largest input in the recordings, input units (not fitted).
    """

    cut: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    sharpness: Float[Array, "..."] = eqx.field(converter=real, default=2.0)
    largest: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = "drive_saturation"
    about: ClassVar[About] = About(
        sentence="a drive gain that falls with the amplitude of its input (soft saturation)",
        equation="u -> u/(1 + k (|u|/largest)^sharpness)^(1/sharpness), k = (1 - cut)^-sharpness - 1",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
        source="Rapp 1991 (amplifier model)",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (_CUT,)
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sharpness", "1", "of the bend", "log", lower=1.0, upper=10.0, grid=(2.0,)),
        _LARGEST,
    )

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        # The power of zero has no derivative by its exponent.
        size = jnp.abs(u) / self.largest
        power = jnp.where(size > 0.0, jnp.where(size > 0.0, size, 1.0) ** self.sharpness, 0.0)
        k = jnp.expm1(-self.sharpness * jnp.log1p(-self.cut))
        return u * (1.0 + k * power) ** (-1.0 / self.sharpness)


class HardSaturation(AbstractInputEffect):
    """u -> clip(u, -limit, limit) with limit = (1 - cut) largest; nothing is clipped when `cut` is 0.

    **Arguments:**

    - `cut`: part of the largest input that has no effect.
    - `largest`: largest input in the recordings, input units (not fitted).
    """

    cut: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    largest: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    name: ClassVar[str] = "drive_saturation"
    about: ClassVar[About] = About(
        sentence="a drive that gives no more force beyond a limit of its input",
        equation="u -> clip(u, -limit, limit), limit = (1 - cut) largest",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (_CUT,)
    nuisances: ClassVar[tuple[Parameter, ...]] = (_LARGEST,)

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        size = jnp.abs(u)
        limit = (1.0 - self.cut) * self.largest
        clipped = jnp.where(size < limit, u, jnp.sign(u) * limit)
        # A cut of zero is the base model, also for larger inputs; a small one acts on the largest samples only.
        affected = jnp.where(size == self.largest, self.cut * self.largest, 0.0)
        return jnp.where(self.cut > 0.0, clipped, u - jnp.sign(u) * affected)
