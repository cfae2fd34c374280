"""Whether a held-out recording is a copy of one to fit: then it validates nothing."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.recording import Recording

_CHANGED = 0.01  # part of the changes of speed that may differ in a copy
_LEAST = 6  # such changes that may differ in a short one: two samples that were changed
_FIRST_LOOK = 250  # changes that are compared first


def copied_from(kept: Recording, fitted: Sequence[Recording]) -> Recording | None:
    """The recording of which `kept` is a copy, but for an offset and few samples; None where there is none.

    Two runs of one experiment never agree to the last digit while the machine moves: noise, and the moments when an
    encoder counts, differ. So what is compared is the second differences of the position, where there are any: two
    recordings of one constant speed without noise are no copies. A copy may be shorter, from the first sample on.

    **Arguments:**

    - `kept`: the held-out recording.
    - `fitted`: the recordings to fit.
    """
    for other in fitted:
        if np.array_equal(kept.x, other.x) or _is_copy(kept.x, other.x):
            return other
    return None


def _is_copy(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " m"]) -> bool:
    size = min(one.size, other.size)
    one, other = one[:size], other[:size]
    # A few show of most pairs that they differ: hundreds of recordings make thousands of pairs.
    few = np.arange(0, size - 2, max(size // _FIRST_LOOK, 1))
    one_few, other_few = (x[few + 2] - 2.0 * x[few + 1] + x[few] for x in (one, other))
    changed, _ = _differing(one_few, other_few, _rounding(one[few], other[few]), 0.5)
    if changed:
        return False
    changed, some = _differing(np.diff(one, 2), np.diff(other, 2), _rounding(one, other), _CHANGED)
    return some and not changed


def _rounding(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"]) -> float:
    """How far two second differences of positions that are the same may differ."""
    return 8.0 * float(np.spacing(max(np.abs(one).max(), np.abs(other).max())))


def _differing(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"], rounding: float, part: float
) -> tuple[bool, bool]:
    """Whether more than a `part` of the changes of speed differ, and more than a few; and whether there are any."""
    there = (np.abs(first) > rounding) | (np.abs(second) > rounding)
    differ, whole = np.count_nonzero(np.abs(first - second)[there] > rounding), np.count_nonzero(there)
    return bool(differ > max(part * whole, _LEAST)), bool(whole > 0)
