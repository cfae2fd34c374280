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
_SMALL = 1e-3  # below it the series is exact to the last bits


class SoftSaturation(AbstractInputEffect):
    """u -> tanh(c u)/c with c^2 = softness.

    **Arguments:**

    - `softness`: square of the inverse of the largest input that acts, 1/input^2, not negative.
    """

    softness: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "drive_saturation"
    about: ClassVar[About] = About(
        sentence="a drive gain that falls with the amplitude of its input (soft saturation)",
        equation="u -> tanh(c u)/c, c^2 = softness",
        shows=_SHOWS,
        confused_with=_CONFUSED,
        split_by=_SPLIT,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "softness", "1/{input}^2", "square of 1/limit", scale="1/u^2", lower=0.0, probes=(0.1, 1.0)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        # tanh(r)/r is analytic in r^2.
        q = self.softness * u * u
        small = q < _SMALL
        r = jnp.sqrt(jnp.where(small, 1.0, q))
        p = jnp.where(small, q, 0.0)
        series = 1.0 - p * (1.0 / 3.0 - p * (2.0 / 15.0 - p * (17.0 / 315.0 - p * (62.0 / 2835.0))))
        return u * jnp.where(small, series, jnp.tanh(r) / r)


class HardSaturation(AbstractInputEffect):
    """u -> clip(u, -limit, limit) with limit = (1 - cut) largest; nothing is clipped when `cut` is 0.

    **Arguments:**

    - `cut`: part of the largest input that has no effect.
    - `largest`: largest input that the recordings hold, input units (not fitted).
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
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cut", "1", "part of the largest input cut off", lower=0.0, upper=0.95, probes=(0.1, 0.4)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("largest", "{input}", "largest input", "none", scale="u", grid=(1.0,)),
    )

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        size = jnp.abs(u)
        limit = (1.0 - self.cut) * self.largest
        clipped = jnp.where(size < limit, u, jnp.sign(u) * limit)
        # A cut of zero is the base model, also for larger inputs; a small one is felt by the largest samples alone.
        felt = jnp.where(size == self.largest, self.cut * self.largest, 0.0)
        return jnp.where(self.cut > 0.0, clipped, u - jnp.sign(u) * felt)
