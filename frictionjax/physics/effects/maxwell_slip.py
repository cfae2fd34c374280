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

    The yield deflections have mean Fs/sigma0 and logarithms spread * q + skew * q^2 (up to a constant), with q evenly
    spaced in (-1, 1): a small spread means elements that yield together, a large one hysteresis from the first
    micrometre on. (LuGre's own virgin curve, an exponential, is near spread 1.9 and skew -0.5; only the memory at
    reversals differs.) Stiffness at the origin and sliding level stay those of the base model.

    **Arguments:**

    - `share`: part of the stiffness in elasto-slip elements, in [0, 1].
    - `spread`: half the logarithm of the ratio of largest to smallest yield.
    - `skew`: bends the distribution: positive when most yields are small.
    """

    share: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    spread: Float[Array, "..."] = eqx.field(converter=real, default=1.5)
    skew: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    # The width of a processor's vector unit.
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
        Parameter(
            "share", "1", "share of the stiffness", lower=0.0, upper=1.0, probes=(0.05, 0.4), other_start=0.5
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter("spread", "1", "half log range of yields", "log", lower=0.1, upper=4.0, grid=(1.0, 2.0)),
        Parameter("skew", "1", "bend of the log yields", lower=-1.5, upper=1.5, grid=(0.0,)),
    )

    def share_and_yield(self) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
        q = 2.0 * (jnp.arange(self.count, dtype=self.spread.dtype) + 0.5) / self.count - 1.0
        slack = jnp.exp(self.spread * q + self.skew * q * q)
        return jnp.full((self.count,), 1.0 / self.count) * self.share, slack / jnp.mean(slack)
