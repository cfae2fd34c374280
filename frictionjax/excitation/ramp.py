"""A slow ramp: the break-away experiment."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import InputError


def ramp(
    n: int, sample_rate: float, level: float | Float[Array, ""], *, rest: float = 0.0, hold: float = 0.0
) -> Float[Array, " n"]:
    """From zero to `level` at a constant rate, as in the paper's break-away experiment (Fig. 5).

    **Arguments:**

    - `n`: number of samples.
    - `sample_rate`: samples per second, Hz.
    - `level`: level that is reached, in the unit of the signal; its sign is the direction.
    - `rest`: time at zero before the ramp, s, from which the sensor's noise can be read.
    - `hold`: time at `level` after it, s; a creeping machine goes on moving then.

    **Returns:** the signal, shape `(n,)`.

    **Raises:** `InputError` when `rest` and `hold` leave no time for the ramp.
    """
    rise = (n - 1) / sample_rate - rest - hold
    if rest < 0.0 or hold < 0.0 or rise <= 0.0:
        raise InputError(
            f"`rest` = {rest} s and `hold` = {hold} s leave {rise:.4g} s of {n / sample_rate:.4g} s for the ramp",
            cure="Give them positive values that leave time, or a larger `n`.",
        )
    return level * jnp.asarray(np.clip((np.arange(n) / sample_rate - rest) / rise, 0.0, 1.0))
