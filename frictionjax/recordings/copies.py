"""Whether a held-out recording is a copy of one to fit: then it validates nothing."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.recording import Recording

_CHANGED = 0.01  # part of the steps of a moving position that may differ in a copy
_LEAST = 4  # such steps that may differ in a short one: two samples that were changed
_FIRST_LOOK = 250  # steps that are compared first


def copied_from(kept: Recording, fitted: Sequence[Recording]) -> Recording | None:
    """The recording of which `kept` is a copy, but for an offset and few samples; None where there is none.

    Two runs of one experiment never agree to the last digit while the machine moves: noise, and the moments when an
    encoder counts, differ. So what is compared is the steps of the position from sample to sample, where either
    recording moves. A copy may be shorter, from the first sample on.

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
    # A few steps show of most pairs that they differ: hundreds of recordings make thousands of pairs.
    few = np.arange(0, size - 1, max(size // _FIRST_LOOK, 1))
    if not _agree(one[few + 1] - one[few], other[few + 1] - other[few], _rounding(one[few], other[few]), 0.5):
        return False
    return _agree(np.diff(one), np.diff(other), _rounding(one, other), _CHANGED)


def _rounding(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"]) -> float:
    """How far two differences of positions that are the same may differ."""
    return 4.0 * float(np.spacing(max(np.abs(one).max(), np.abs(other).max())))


def _agree(
    first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"], rounding: float, part: float
) -> bool:
    """Whether no more than a `part` of the steps differ, of those where either moves, or no more than a few."""
    moving = (np.abs(first) > rounding) | (np.abs(second) > rounding)
    changed = np.count_nonzero(np.abs(first - second)[moving] > rounding)
    return bool(changed <= max(part * np.count_nonzero(moving), _LEAST))
