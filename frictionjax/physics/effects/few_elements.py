"""Presliding hysteresis of a few elasto-slip elements, each with a stiffness and a yield of its own."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractBristleEffect


def _three(name: str, meaning: str, lower: float, upper: float) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{name}{number}", "1", meaning, "log", lower=lower, upper=upper, grid=(1.0,))
        for number in (1, 2, 3)
    )


class FewElements(AbstractBristleEffect):
    """Part of the bristle stiffness is carried by four parallel elements that stick, then slip at their own deflection.

    Where a few contacts carry most of the load, no smooth distribution of yields (`MaxwellSlip`) describes them. The
    mean of the yields, weighted by stiffness, is Fs/sigma0: stiffness at the origin and sliding level stay those of the
    base model.

    **Arguments:**

    - `share`: part of the stiffness in elasto-slip elements, in [0, 1].
    - `step1`, `step2`, `step3`: logarithms of the ratio of each yield to the one below it.
    - `weight1`, `weight2`, `weight3`: stiffness of each over that of the one that yields first.
    """

    share: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    step1: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    step2: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    step3: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    weight1: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    weight2: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    weight3: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    count: ClassVar[int] = 4
    name: ClassVar[str] = "maxwell_slip"
    about: ClassVar[About] = About(
        sentence="presliding hysteresis with non-local memory (a few Maxwell-slip elements)",
        equation="F = (1 - share) sigma0 z + sum_j k_j z_j; element j sticks until |z_j| reaches its yield",
        shows="presliding: corners of the loops at a few deflections",
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
        *_three("step", "logarithm of a yield over the one below it", 0.02, 4.0),
        *_three("weight", "stiffness over that of the first element", 0.02, 50.0),
    )

    def share_and_yield(self) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
        steps = jnp.stack([jnp.zeros_like(self.step1), self.step1, self.step2, self.step3])
        weights = jnp.stack([jnp.ones_like(self.weight1), self.weight1, self.weight2, self.weight3])
        weights, slack = weights / jnp.sum(weights), jnp.exp(jnp.cumsum(steps))
        return self.share * weights, slack / jnp.sum(weights * slack)
