"""Band-limited Gaussian noise."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from frictionjax.core import InputError


def gaussian_noise(
    key: PRNGKeyArray,
    n: int,
    sample_rate: float,
    bandwidth: float,
    rms: float | Float[Array, ""],
    *,
    low: float = 0.0,
) -> Float[Array, " n"]:
    """Gaussian noise with a flat spectrum up to `bandwidth` and nothing above.

    Its peaks reach about four times its rms: at a quarter of break-away it may slip now and then.

    **Arguments:**

    - `key`: key of `jax.random`.
    - `n`: number of samples, after which the signal could be repeated without a jump.
    - `sample_rate`: samples per second, Hz.
    - `bandwidth`: upper end of the band, Hz; at most half of `sample_rate`.
    - `rms`: root mean square of these `n` samples, in the unit of the signal.
    - `low`: lower end of the band, Hz. The mean is left out in any case.

    **Returns:** the signal, shape `(n,)`.

    **Raises:** `InputError` when no multiple of `sample_rate / n` lies in the band.
    """
    # Lines are whole numbers of periods: the band is compared with them as integers, so that rounding moves no edge.
    first, last = max(1, -int(-low * n // sample_rate)), min(n // 2, int(bandwidth * n // sample_rate))
    if last < first:
        raise InputError(
            f"the band from {low} to {bandwidth} Hz is empty for {n} samples at {sample_rate} Hz",
            cure=f"Widen it: its lines are multiples of {sample_rate / n:.4g} Hz up to {sample_rate / 2.0} Hz.",
        )
    return _filtered(key, rms, first, last, n)


@functools.partial(jax.jit, static_argnames="n")
def _filtered(
    key: PRNGKeyArray,
    rms: float | Float[Array, ""],
    first: int | Int[Array, ""],
    last: int | Int[Array, ""],
    n: int,
) -> Float[Array, " n"]:
    """Noise on the lines from the `first` to the `last`."""
    line = jnp.arange(n // 2 + 1)
    spectrum = jnp.where((line >= first) & (line <= last), jnp.fft.rfft(jax.random.normal(key, (n,))), 0.0)
    signal = jnp.fft.irfft(spectrum, n)
    return rms * signal / jnp.sqrt(jnp.mean(signal**2))
