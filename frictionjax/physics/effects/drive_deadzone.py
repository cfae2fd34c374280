"""Input without effect around zero."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractInputEffect


class DriveDeadzone(AbstractInputEffect):
    """u -> u - clip(u, -width, width).

    **Arguments:**

    - `width`: largest input without effect, input units, not negative.
    """

    width: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "drive_deadzone"
    about: ClassVar[About] = About(
        sentence="a drive whose input has no effect around zero (dead zone)",
        equation="u -> u - clip(u, -width, width)",
        shows="small inputs: presliding with a gain that falls towards small levels",
        confused_with=("nonlinear_bristle", "maxwell_slip"),
        split_by="presliding noise of several levels around a constant input",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("width", "{input}", "half the dead zone", scale="u", lower=0.0, probes=(0.002, 0.02, 0.1)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        # jnp.sign: an input of exactly zero loses nothing, and has no derivative in the width.
        return u - jnp.where(jnp.abs(u) < self.width, u, jnp.sign(u) * self.width)
