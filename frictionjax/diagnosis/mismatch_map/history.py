"""What came just before each moment of a recording: the last reversal, and how long the last rest was.

Told from a velocity alone. A *rest* is a stretch in which the speed stays below a threshold; shorter motions than
`_SHORTEST_MOTION` do not end it, for noise makes such motions too.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

_SHORTEST_MOTION = 5e-3  # s
_ONSET = 20e-3  # s: the break-away that a motion begins with belongs to the motion, not to the rest


def last_reversal(v: Float[np.ndarray, " n"], slow: float) -> Int[np.ndarray, " n"]:
    """Index of the sample at which the motion last turned round; -1 before the first time.

    **Arguments:**

    - `v`: velocity, shape `(n,)`.
    - `slow`: speed below which the sign of the velocity is not trusted, in the same unit.
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
    seen = turn >= 0
    time = np.where(seen, (np.arange(v.size) - turn) * dt, np.inf)
    return time, np.where(seen, np.abs(x - x[np.maximum(turn, 0)]), np.inf)


def last_rest(
    v: Float[np.ndarray, " n"], slow: float, dt: float
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Length of the last rest before the present motion, s, and which samples are at rest.

    The length is that of the rest itself for a sample at rest, and infinite before the first rest. A rest that the
    recording begins with counts as long as it was recorded. The last 20 ms of a rest count as motion: there the
    bristles yield.

    **Arguments:**

    - `v`: velocity, shape `(n,)`.
    - `slow`: speed below which the machine is at rest, in the same unit.
    - `dt`: s per sample.
    """
    still = np.abs(v) <= slow
    for begin, end in _runs(~still):
        if (end - begin) * dt < _SHORTEST_MOTION:
            still[begin:end] = True
    length, resting = np.full(v.size, np.inf), np.zeros(v.size, bool)
    onset = round(_ONSET / dt)
    for begin, end in _runs(still):
        length[begin:] = (end - begin) * dt
        # The rest that a recording ends with is followed by no motion.
        resting[begin : end if end == v.size else max(end - onset, begin)] = True
    return length, resting


def _runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """Begin and end of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
