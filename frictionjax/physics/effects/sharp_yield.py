"""Presliding that yields more sharply than LuGre's: between LuGre and Maxwell slip."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSlipEffect

# Below this bend the power is linear through zero: this limits a slope too steep for any step.
_LEAST_BEND = 1e-6
# The largest bend where the level falls with velocity; above it the bristle yields in proportion.
_MOST_BEND = 3.0


class SharpYield(AbstractSlipEffect):
    """dz/dt = v - |v| b |b|^exponent_change with b = F_z/G: 0 is LuGre, a large number one elasto-slip element.

    **Arguments:**

    - `exponent_change`: exponent minus 1; negative when yielding starts at once.
    """

    exponent_change: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "maxwell_slip"
    about: ClassVar[About] = About(
        sentence="presliding that yields more sharply, or less, than LuGre's bristle",
        equation="dz/dt = v - |v| b |b|^exponent_change, b = F_z/G(v)",
        shows="presliding: the corner of the loop between elastic and sliding",
        confused_with=("elasto_plastic", "nonlinear_bristle"),
        split_by="nested triangles A > B > A below break-away",
        source="Bouc 1967; Wen 1976",
        needs=("presliding",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("exponent_change", "1", "exponent minus 1", lower=-0.7, upper=15.0, probes=(0.05, 1.5)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def slip(self, bend: Float[Array, "*d"], direction: Float[Array, "*d"]) -> Float[Array, "*d"]:
        # Not `power`: that has no slope at zero, where the base model has the slope 1.
        logarithm = jnp.log(jnp.clip(jnp.abs(bend), _LEAST_BEND, _MOST_BEND))
        return bend * jnp.exp(self.exponent_change * logarithm)
