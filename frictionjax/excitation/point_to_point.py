"""Moves of a servo from one position to the next."""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import InputError


def point_to_point(
    n: int,
    sample_rate: float,
    positions: Sequence[float] | Float[Array, " stops"],
    durations: float | Sequence[float],
    *,
    rests: float | Sequence[float] = 0.5,
) -> Float[Array, " n"]:
    """A reference that starts at zero and visits `positions`, each move with the least jerk that its time allows.

    The move by `D` in `T` is `D (10 s^3 - 15 s^4 + 6 s^5)` with `s = t / T`: it starts and ends without velocity and
    acceleration, and its peak velocity is `1.875 D / T` (Flash and Hogan 1985). Slow moves show the Stribeck curve,
    fast ones viscous friction, the rests before them dwell and break-away.

    **Arguments:**

    - `n`: number of samples; after the last move the reference stays where it is.
    - `sample_rate`: samples per second, Hz.
    - `positions`: where the moves end, shape `(stops,)`, in position units.
    - `durations`: how long each move takes, s, shape `(stops,)`, or one number for all.
    - `rests`: how long the reference stands still before each move, s, shape `(stops,)`, or one number for all.

    **Returns:** the reference, shape `(n,)`, in position units.

    **Raises:** `InputError` when `durations` or `rests` are of another length than `positions` or not positive, or
        when the moves take longer than `n` samples.
    """
    stops = jnp.asarray(positions, float)
    if stops.ndim != 1 or stops.size == 0:
        raise InputError(
            f"`positions` has the shape {stops.shape}", cure="Give one or more positions in a list."
        )
    times = {"durations": np.asarray(durations, float), "rests": np.asarray(rests, float)}
    for name, value in times.items():
        if value.shape not in ((), stops.shape):
            raise InputError(
                f"`{name}` holds {value.size} values for {stops.size} positions",
                cure="Give one for each, or one number for all.",
            )
        if np.any(value < 0.0) or (name == "durations" and np.any(value == 0.0)):
            raise InputError(
                f"`{name}` holds a time that is not positive", cure="Times are in s, above zero."
            )
    T, pause = (np.broadcast_to(value, stops.shape) for value in times.values())
    end = np.cumsum(T + pause)
    if end[-1] > n / sample_rate:
        raise InputError(
            f"the moves take {end[-1]:.4g} s and the signal lasts {n / sample_rate:.4g} s",
            cure=f"Make `n` at least {int(np.ceil(end[-1] * sample_rate))}, or the moves and rests shorter.",
        )
    s = np.clip((np.arange(n)[:, None] / sample_rate - (end - T)[None, :]) / T[None, :], 0.0, 1.0)
    steps = jnp.diff(stops, prepend=jnp.zeros(1))
    return jnp.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2)) @ steps
