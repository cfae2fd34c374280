"""First-order lag of the drive or its current loop."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractInputEffect, Along
from frictionjax.physics.push import Push


class DriveLag(AbstractInputEffect):
    """time_constant di/dt = u - i, the plant receives i; solved exactly for an input held between samples.

    Mean and first moment of the current are exact in each sample. Below a sample a lag, a delay and a clock that stamps
    u too early are one class: all shift the force by a part of a sample.

    **Arguments:**

    - `time_constant`: s, not negative.
    """

    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    along: ClassVar[Along] = "input_rate"
    name: ClassVar[str] = "drive_lag"
    about: ClassVar[About] = About(
        sentence="a first-order lag of the drive",
        equation="time_constant di/dt = u - i, force = km i",
        shows="fast changes of the input; a gain that falls with frequency",
        confused_with=("delay",),
        split_by="noise or a multisine up to 0.3/time_constant: a lag lowers the gain, a delay keeps it",
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("time_constant", "s", "time constant", scale="dt", lower=0.0, probes=(0.1, 1.0, 3.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Push:
        ratio = self.time_constant / dt
        active = ratio > 1e-3  # exp(-1/ratio) is 0 to the last bit below
        decay = jnp.where(active, jnp.exp(-1.0 / jnp.where(active, ratio, 1.0)), 0.0)
        integral = ratio * (1.0 - decay)

        def sample(lagged, held):
            behind = lagged - held
            off = behind * (ratio * (1.0 - integral) - 0.5 * integral)
            return held + behind * decay, (held + behind * integral, off)

        mean, off = jax.lax.scan(sample, u[0] + 0.0 * ratio, u)[1]
        return Push(mean, -12.0 * off)
