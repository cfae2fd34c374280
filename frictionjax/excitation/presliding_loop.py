"""Slow loops below break-away, which show hysteresis with non-local memory."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import InputError


def presliding_loop(
    n: int,
    sample_rate: float,
    level: float | Float[Array, ""],
    *,
    nested: Sequence[float] = (),
    cycles: int = 1,
    rest: float = 0.0,
) -> Float[Array, " n"]:
    """A triangle to `level` and back to `-level`, at one rate throughout, with smaller loops inside on request.

    The paper's Fig. 2 is the plain loop. With `nested = (b1, b2)`, fractions of `level`, the line goes on from
    `-level` to `b1`, `-b1`, `b2`, `-b2`, and from there up to `level` again, through `b2` and `b1`. Hysteresis with
    non-local memory then closes each small loop where it began, and follows the large one as if there had been
    none; a single bristle does neither.

    **Arguments:**

    - `n`: number of samples.
    - `sample_rate`: samples per second, Hz.
    - `level`: level of the outer loop, in the unit of the signal.
    - `nested`: levels of the inner loops as fractions of `level`, each smaller than the one before.
    - `cycles`: how often the whole is gone through.
    - `rest`: time at zero at the beginning and again at the end, s.

    **Returns:** the signal, shape `(n,)`; it ends at zero.

    **Raises:** `InputError` when `nested` does not decrease within (0, 1), `cycles` is below 1, or `rest` leaves
        no time.
    """
    inner = np.asarray(nested, float)
    if np.any(np.diff([1.0, *inner, 0.0]) >= 0.0):
        raise InputError(
            f"`nested` = {tuple(nested)} must hold fractions of `level`, each below the one before it",
            cure="Write them in decreasing order, all between 0 and 1.",
        )
    if cycles < 1:
        raise InputError(f"`cycles` is {cycles}", cure="Go through the loop at least once.")
    moving = (n - 1) / sample_rate - 2.0 * rest
    if rest < 0.0 or moving <= 0.0:
        raise InputError(
            f"`rest` = {rest} s twice leaves {moving:.4g} s of {n / sample_rate:.4g} s for the loop",
            cure="Give it a positive value that leaves time, or a larger `n`.",
        )
    once = [1.0, -1.0, *np.stack([inner, -inner], axis=1).ravel()]
    corners = (
        np.array([0.0, *(once * cycles), 1.0, 0.0]) if nested else np.array([0.0, *(once * cycles), 0.0])
    )
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)))])
    way = np.clip((np.arange(n) / sample_rate - rest) / moving, 0.0, 1.0) * path[-1]
    return level * jnp.asarray(np.interp(way, path, corners))
