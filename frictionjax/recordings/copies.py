"""Whether a held-out recording is a copy of one to fit: then it validates nothing."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.recording import Recording

_CHANGED = 0.01  # part of the bends of a position that may differ in a copy
_LEAST = 6  # such bends that may differ in a short one: two samples that were changed
_ENOUGH = 10  # times as many bends must there be: a straight line is like any other
_FIRST_LOOK = 250  # places that are compared first


def copied_from(kept: Recording, fitted: Sequence[Recording]) -> Recording | None:
    """The recording of which `kept` is a copy, but for few samples; None where there is none.

    Two runs of one experiment never agree to the last digit while the machine moves: noise, and the moments when an
    encoder counts, differ. So what is compared is the second differences of the position, wherever either recording has
    one; at rest and at a constant velocity there is none. A copy has the same input, or force, and may be shorter, from
    the first sample on.

    **Arguments:**

    - `kept`: the held-out recording.
    - `fitted`: the recordings to fit.
    """
    for other in fitted:
        if np.array_equal(kept.x, other.x) or (_same_input(kept, other) and _is_copy(kept.x, other.x)):
            return other
    return None


def _same_input(kept: Recording, other: Recording) -> bool:
    """Whether what acted was the same, at all but few samples: a motion without noise may repeat itself."""
    first, second = ((r.u if r.force is None else r.force) for r in (kept, other))
    size = min(first.size, second.size)
    return bool(np.mean(first[:size] != second[:size]) <= _CHANGED)


def _is_copy(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " m"]) -> bool:
    size = min(one.size, other.size)
    one, other = one[:size], other[:size]
    # A few places show of most pairs that they differ: hundreds of recordings make thousands of pairs.
    few = np.arange(0, size - 2, max(size // _FIRST_LOOK, 1))
    rounding = 8.0 * float(np.spacing(max(np.abs(one).max(), np.abs(other).max())))
    first, second = (x[few + 2] - 2.0 * x[few + 1] + x[few] for x in (one, other))
    bent, changed = _compared(first, second, rounding)
    if changed > max(0.5 * bent, _LEAST):
        return False
    if abs(float(np.median(one - other))) > rounding:
        return False
    bent, changed = _compared(np.diff(one, 2), np.diff(other, 2), rounding)
    return bent > _ENOUGH * _LEAST and changed <= max(_CHANGED * bent, _LEAST)


def _compared(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"], rounding: float
) -> tuple[int, int]:
    """How many of the second differences are not zero in one of the recordings, and how many of these differ."""
    bent = (np.abs(first) > rounding) | (np.abs(second) > rounding)
    return int(np.count_nonzero(bent)), int(np.count_nonzero(np.abs(first - second)[bent] > 2.0 * rounding))
