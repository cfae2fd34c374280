"""Presliding hysteresis with non-local memory: parallel elasto-slip elements."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractBristleEffect


class MaxwellSlip(AbstractBristleEffect):
    """Part of the bristle stiffness is carried by parallel elements that stick, then slip at their own deflection.

    The yield deflections follow a Weibull distribution of mean Fs/sigma0 and exponent `shape`: with shape 1 the
    virgin curve is LuGre's own (an exponential, here a polygon of `count` sides) and only the memory at reversals
    differs; a larger shape means elements that yield together. Stiffness at the origin and sliding level stay those
    of the base model.

    **Arguments:**

    - `share`: part of the stiffness in elasto-slip elements, in [0, 1].
    - `shape`: Weibull exponent of the yield deflections.
    """

    share: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    shape: Float[Array, "..."] = eqx.field(converter=real, default=1.5)

    count: ClassVar[int] = 8
    name: ClassVar[str] = "maxwell_slip"
    about: ClassVar[About] = About(
        sentence="presliding hysteresis with non-local memory (Maxwell slip)",
        equation="F = (1 - share) sigma0 z + share sigma0 mean(z_j); element j sticks until |z_j| reaches its yield",
        shows="presliding: reversals below break-away, nested loops",
        confused_with=("elasto_plastic",),
        split_by="nested triangles A > B > A below break-away",
        source="Iwan 1966; Lampaert, Swevers, Al-Bender 2002 (GMS)",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", "share of the stiffness", lower=0.0, upper=1.0, probes=(0.05, 0.4)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "shape", "1", "Weibull exponent of the yields", "log", lower=0.5, upper=6.0, grid=(1.0, 2.0)
        ),
    )

    def share_and_yield(self) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
        quantile = (jnp.arange(self.count, dtype=self.shape.dtype) + 0.5) / self.count
        spread = (-jnp.log1p(-quantile)) ** (1.0 / self.shape)
        return jnp.full((self.count,), 1.0 / self.count) * self.share, spread / jnp.mean(spread)
