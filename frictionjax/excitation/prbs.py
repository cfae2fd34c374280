"""Random binary noise, the excitation of the paper."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from frictionjax.core import InputError

HALF_POWER = 0.4429  # sinc(f)^2 = 1/2: part of its clock at which held binary noise has half its power


def prbs(
    key: PRNGKeyArray, n: int, sample_rate: float, bandwidth: float, rms: float | Float[Array, ""]
) -> Float[Array, " n"]:
    """Binary noise: `+rms` or `-rms`, drawn anew at every tick of a clock and held in between.

    Of all signals of a given peak it has the most power, and its peak is its rms. Held
    for `T` seconds, it has the spectrum `sinc(f T)^2`; the clock is set so that half the power is left at
    `bandwidth`. There are as many ticks up as down (to within one), as in a maximum-length sequence, so that the
    machine is not pushed away; unlike the shifts of one such sequence, two keys give independent realisations.

    **Arguments:**

    - `key`: key of `jax.random`.
    - `n`: number of samples.
    - `sample_rate`: samples per second, Hz.
    - `bandwidth`: frequency up to which there should be power, Hz; at most half of `sample_rate`.
    - `rms`: root mean square, which is the peak too, in the unit of the signal.

    **Returns:** the signal, shape `(n,)`.

    **Raises:** `InputError` when `bandwidth` is not in `(0, sample_rate / 2]`.
    """
    if not 0.0 < bandwidth <= sample_rate / 2.0:
        raise InputError(
            f"`bandwidth` is {bandwidth} Hz, which noise at {sample_rate} samples per second cannot have",
            cure=f"Choose a value above 0 and not above {sample_rate / 2.0} Hz.",
        )
    return _held(key, rms, n, max(1, int(HALF_POWER * sample_rate / bandwidth)))


@functools.partial(jax.jit, static_argnames=("n", "hold"))
def _held(key: PRNGKeyArray, rms: float | Float[Array, ""], n: int, hold: int) -> Float[Array, " n"]:
    """Binary noise that is held for so many samples, `hold`."""
    ticks = -(-n // hold)
    balanced = jnp.where(jnp.arange(ticks) % 2 == 0, 1.0, -1.0)
    return rms * jnp.repeat(jax.random.permutation(key, balanced), hold)[:n]
