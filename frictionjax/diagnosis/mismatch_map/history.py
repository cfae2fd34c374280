"""What preceded each sample of a recording: the last reversal, and the duration of the last rest.

From the velocity alone. A *rest* is an interval in which the speed stays below a threshold; motions shorter than
`_SHORTEST_MOTION` do not end it, since noise causes such motions, too.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.recordings.regimes import runs

_SHORTEST_MOTION = 5e-3  # s
_ONSET = 20e-3  # s: the break-away at the start of a motion belongs to the motion, not to the rest


def last_reversal(v: Float[np.ndarray, " n"], slow: float) -> Int[np.ndarray, " n"]:
    """Index of the sample at which the motion last reversed; -1 before the first reversal.

    **Arguments:**

    - `v`: velocity, shape `(n,)`.
    - `slow`: speed below which the sign of the velocity is noise, in the same unit.
    """
    moving = np.flatnonzero(np.abs(v) > slow)
    turned = np.full(v.size, -1)
    if moving.size > 1:
        turns = moving[1:][np.diff(np.sign(v[moving])) != 0]
        turned[turns] = turns
    return np.maximum.accumulate(turned)


def since_reversal(
    x: Float[np.ndarray, " n"], v: Float[np.ndarray, " n"], slow: float, dt: float
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Time (s) and distance (position units) since the last reversal; infinite before the first.

    **Arguments:**

    - `x`, `v`: position and velocity, shape `(n,)`.
    - `slow`: as in `last_reversal`.
    - `dt`: s per sample.
    """
    turn = last_reversal(v, slow)
    reversed_before = turn >= 0
    time = np.where(reversed_before, (np.arange(v.size) - turn) * dt, np.inf)
    return time, np.where(reversed_before, np.abs(x - x[np.maximum(turn, 0)]), np.inf)


def last_rest(
    v: Float[np.ndarray, " n"], slow: float, dt: float
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Duration of the last rest before the present motion, s, and which samples are at rest.

    For a sample at rest it is that of the rest itself; before the first rest it is infinite. A rest at the beginning of
    the recording counts with the duration recorded. The last 20 ms of a rest count as motion: there the bristles yield.

    **Arguments:**

    - `v`: velocity, shape `(n,)`.
    - `slow`: speed below which the machine is at rest, in the same unit.
    - `dt`: s per sample.
    """
    still = np.abs(v) <= slow
    for begin, end in runs(~still):
        if (end - begin) * dt < _SHORTEST_MOTION:
            still[begin:end] = True
    length, resting = np.full(v.size, np.inf), np.zeros(v.size, bool)
    onset = round(_ONSET / dt)
    for begin, end in runs(still):
        length[begin:] = (end - begin) * dt
        # No motion follows a rest at the end of the recording.
        resting[begin : end if end == v.size else max(end - onset, begin)] = True
    return length, resting
