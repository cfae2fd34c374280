"""Pure delay of the input."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractInputEffect, Along
from frictionjax.physics.push import Push


class Delay(AbstractInputEffect):
    """The plant receives u(t - delay), as it seems to where the recorder's clock stamps u too early; below a sample a
    lag looks the same.

    For an input held between samples the delayed input changes once within a sample, from one of two neighbours to the
    other: mean and first moment are exact, which makes the delay differentiable (an integer shift would have no
    gradient).

    **Arguments:**

    - `delay`: s, not negative.
    """

    delay: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    along: ClassVar[Along] = "input_rate"
    name: ClassVar[str] = "delay"
    about: ClassVar[About] = About(
        sentence="a pure delay between input and force",
        equation="u(t) -> u(t - delay)",
        shows="fast changes of the input; a phase that falls linearly with frequency",
        confused_with=("drive_lag",),
        split_by="noise or a multisine up to 0.3/delay: a delay keeps the gain, a lag lowers it",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("delay", "s", "delay", scale="dt", lower=0.0, probes=(0.1, 1.0, 3.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Push:
        samples = self.delay / dt
        whole = jnp.floor(samples)
        part = samples - whole
        index = jnp.arange(u.shape[0]) - whole.astype(int)
        # Before the first sample the input is taken to have been at its first value.
        newer = u[jnp.clip(index, 0, u.shape[0] - 1)]
        older = u[jnp.clip(index - 1, 0, u.shape[0] - 1)]
        return Push((1.0 - part) * newer + part * older, 6.0 * part * (1.0 - part) * (newer - older))
