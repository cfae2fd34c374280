"""A sum of sines on chosen lines, with random phases."""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from frictionjax.core import InputError
from frictionjax.core.arrays import Numbers


def multisine(
    key: PRNGKeyArray,
    n: int,
    sample_rate: float,
    lines_or_band: tuple[float, float] | Sequence[float] | np.ndarray,
    rms: float | Float[Array, ""],
    *,
    odd: bool = False,
) -> Float[Array, " n"]:
    """Sines of equal amplitude and independent uniform phases, periodic in `n` samples.

    With `odd`, the even lines are left silent and become detection lines: an even nonlinearity (direction-dependent
    friction, a load) responds on them, an odd one (friction) does not, and neither reaches the odd lines in the
    same way (Pintelon and Schoukens, System Identification, 2nd ed., 2012, ch. 4). `multisine_lines` draws odd lines
    with some left out, whose `frequency` is then `lines_or_band` here.

    **Arguments:**

    - `key`: key of `jax.random`.
    - `n`: number of samples, one period.
    - `sample_rate`: samples per second, Hz.
    - `lines_or_band`: a tuple `(low, high)`: every line from `low` to `high`, Hz; or a list or an array of
        frequencies, Hz: the lines nearest to these. Lines are multiples of `sample_rate / n`.
    - `rms`: root mean square, in the unit of the signal.
    - `odd`: whether only odd multiples of `sample_rate / n` are used.

    **Returns:** the signal, shape `(n,)`.

    **Raises:** `InputError` when no line is left, or when one lies beyond half of `sample_rate`.
    """
    step = sample_rate / n
    if isinstance(lines_or_band, tuple) and len(lines_or_band) == 2:
        # The small margin keeps an edge that is a line itself, whatever the division rounds to.
        low, high = (edge / step for edge in lines_or_band)
        lines = np.arange(max(1, np.ceil(low - 1e-6)), np.floor(high + 1e-6) + 1).astype(int)
    else:
        lines = np.unique(np.round(np.asarray(lines_or_band, float) / step).astype(int))
    lines = lines[lines % 2 == 1] if odd else lines
    if lines.size == 0 or lines[0] < 1 or 2 * lines[-1] >= n:
        raise InputError(
            f"`lines_or_band` = {lines_or_band} gives no {'odd ' if odd else ''}lines that {n} samples at "
            f"{sample_rate} Hz can carry",
            cure=f"Choose frequencies from {step:.4g} Hz to below {sample_rate / 2.0} Hz, or a larger `n`.",
        )
    return _sines(key, lines, rms, n)


@functools.partial(jax.jit, static_argnames="n")
def _sines(
    key: PRNGKeyArray, lines: Int[Numbers, " f"], rms: float | Float[Array, ""], n: int
) -> Float[Array, " n"]:
    """Sines of equal amplitude on the `lines`."""
    phase = jax.random.uniform(key, lines.shape, minval=-jnp.pi, maxval=jnp.pi)
    spectrum = jnp.zeros(n // 2 + 1, complex).at[lines].set(jax.lax.complex(jnp.cos(phase), jnp.sin(phase)))
    # One line of unit magnitude has the rms sqrt(2) / n after the inverse transform.
    return rms * n / np.sqrt(2.0 * lines.size) * jnp.fft.irfft(spectrum, n)
