"""Single channels: noise, quantisation, clipping, and traces of earlier processing."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

_MAX_LEVELS = 16  # an input with no more levels than this has them by design
_CLIPPED = 0.005  # part of the samples at an extreme value, above which it counts as a limit
_SMOOTH = 0.03  # spectral power near the Nyquist frequency over that in mid-band; 1 for white noise
_REPEATED = 0.3  # part of the fast samples that repeat something


def noise_std(x: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of white noise on a smooth signal, from its fourth difference, in units of `x`.

    The weights 1, -4, 6, -4, 1 cancel a cubic and give white noise of unit variance the variance 70.
    """
    return float(np.std(np.diff(x, 4)) / np.sqrt(70.0)) if x.size > 8 else float("nan")


def quantum(x: Float[np.ndarray, " n"]) -> float | None:
    """The step of the grid on which the values lie, in units of `x`; None when they lie on none.

    Every difference of two successive samples is a whole number of quanta. The smallest difference between two
    such differences is the candidate; it is refined by least squares and must then explain 99 % of them. Several
    thresholds for "smallest" allow for values that were printed with few digits.

    **Arguments:**

    - `x`: a channel, shape `(n,)`.

    **Returns:** the quantum, or None.
    """
    steps = np.abs(np.diff(x))
    steps = steps[steps > 0]
    largest = float(np.abs(x).max()) if x.size else 0.0
    if steps.size < 10:
        return None
    spacings = np.diff(np.concatenate([[0.0], np.unique(steps)]))
    for rounding in (1e-15, 1e-10, 1e-9, 1e-8):
        candidates = spacings[spacings > 64 * rounding * largest]
        if not candidates.size:
            return None
        step = _refined(float(candidates.min()), steps)
        if on_grid(x, step) > 0.99:
            return step
    return None


def on_grid(x: Float[np.ndarray, " n"], step: float) -> float:
    """Part of the successive differences of `x` that are a whole number of `step`, to a tenth of it.

    Differences beyond a thousand steps are left out: there the rounding of `step` itself adds up. A channel
    with fewer than ten others gives NaN: they are too few.
    """
    quanta = np.abs(np.diff(x)) / step
    quanta = quanta[quanta < 1000.0]
    moved = quanta[quanta > 1e-6]
    return float(np.mean(np.abs(moved - np.rint(moved)) < 0.1)) if moved.size >= 10 else float("nan")


def _refined(step: float, steps: Float[np.ndarray, " m"]) -> float:
    """Least-squares quantum near `step`, first from the smallest differences, then from larger ones."""
    for reach in (10.0, 100.0, 1000.0):
        near = steps[steps < reach * step]
        whole = np.rint(near / step)
        if whole.any():
            step = float(near @ whole / (whole @ whole))
    return step


class Clipping(eqx.Module):
    """How often a channel is at its extreme values.

    **Attributes:**

    - `levels`: number of distinct values, counted up to 17.
    - `high`, `low`: part of the samples at the largest and at the smallest value.
    - `clipped`: True when the channel reached a limit; False for a signal of few levels.
    """

    levels: int = eqx.field(static=True)
    high: float = eqx.field(static=True)
    low: float = eqx.field(static=True)
    clipped: bool = eqx.field(static=True)


def clipping(values: Float[np.ndarray, " n"]) -> Clipping:
    """Distinguish a channel that reached a limit from one with few levels by design.

    A PRBS, a square wave or a staircase has few levels, whatever its extremes. Otherwise the channel looks
    clipped when it arrives at an extreme value at least three times, stays for two samples or more each time,
    and spends more than half a per cent of the recording there.

    **Arguments:**

    - `values`: a channel, shape `(n,)`.

    **Returns:** the `Clipping`.
    """
    levels = min(np.unique(values).size, _MAX_LEVELS + 1)
    parts, limits = [], []
    for at_limit in (values == values.max(), values == values.min()):
        visits = np.count_nonzero(np.diff(at_limit.astype(np.int8), prepend=0) == 1)
        part = float(np.mean(at_limit))
        parts.append(part)
        limits.append(visits >= 3 and part > _CLIPPED and np.count_nonzero(at_limit) >= 2 * visits)
    return Clipping(levels, *parts, clipped=bool(levels > _MAX_LEVELS and any(limits)))


def processing(x: Float[np.ndarray, " n"], step: float | None) -> str:
    """How a channel was processed before it was stored, as far as the samples show it.

    **Arguments:**

    - `x`: measured position, shape `(n,)`.
    - `step`: its quantum in the same units, None when it lies on no grid.

    **Returns:** `"held"` (each value is repeated: the sensor is slower than the logger), `"interpolated"` (straight
    lines between samples), `"smooth"` (no noise near the Nyquist frequency: low-pass filtered, interpolated, or
    simulated without noise) or `""`.
    """
    first = np.diff(x)
    if x.size < 64 or not first.any():
        return ""
    smallest = step if step is not None else float(np.median(np.abs(first[first != 0])))
    fast = _fast(x, 16.0 * smallest if step is not None else 4.0 * smallest)
    if np.count_nonzero(fast) > 50:
        if np.mean(first[fast] == 0) > _REPEATED:
            return "held"
        bend = np.abs(np.diff(first, append=first[-1]))
        if step is None and np.mean(bend[fast] < 1e-6 * np.abs(first[fast])) > _REPEATED:
            return "interpolated"
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size))) ** 2
    middle, high = (
        np.sum(spectrum[int(a * x.size / 2) : int(b * x.size / 2)]) for a, b in ((0.4, 0.6), (0.8, 1.0))
    )
    return "smooth" if high < _SMOOTH * middle else ""


def _fast(x: Float[np.ndarray, " n"], travel: float) -> Bool[np.ndarray, " n-1"]:
    """Samples in whose neighbourhood of eight steps `x` travels more than `travel`."""
    far = np.abs(x[8:] - x[:-8]) > travel
    return np.concatenate([np.zeros(4, bool), far, np.zeros(3, bool)])
