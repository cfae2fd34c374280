"""Starting values for a load behind a spring, from the antiresonance and the resonance in the recordings.

With a load J2 = ratio J behind a spring, acceleration over force is 1/J below the antiresonance fa and 1/J1 above the
resonance fr, and (fa/fr)^2 = J1/J. Far from the noise no single step from a rigid model reaches such a load: the search
starts at the measured pair.
"""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Complex, Float, Int

from frictionjax.core import InputError
from frictionjax.estimation.data.batch import Batch
from frictionjax.frequency import resonances

_SEGMENT = 0.8  # s: lines of 1.25 Hz
_EXCITED = 0.03  # of the strongest line of the input
_COHERENT = 0.5  # in the middle of the excited lines
_LOWEST = 3.0  # Hz
_CLOSEST, _FURTHEST = 1.02, 3.2  # resonance over antiresonance: J2 from 4 % to 90 % of J


class Pair(NamedTuple):
    """Antiresonance `frequency`, Hz, and `ratio` of the load inertia to the whole, from the resonance."""

    frequency: float
    ratio: float


def resonance_pair(batch: Batch, rows: Int[np.ndarray, " k"]) -> Pair | None:
    """The pair in that of the recordings `rows` of the `batch` with the highest coherence; None where none has one."""
    best: tuple[float, Pair] | None = None
    for row in rows:
        lines = _excited_lines(batch, int(row))
        if lines is None or not lines.coherence > _COHERENT:
            continue
        found = _pair(lines.frequency, lines.response)
        if found is not None and (best is None or lines.coherence > best[0]):
            best = lines.coherence, found
    return best[1] if best is not None else None


def is_coherent(batch: Batch) -> bool:
    """Whether input and position of a recording of the `batch` are coherent where the input excites."""
    found = (_excited_lines(batch, row) for row in range(len(batch.lengths)))
    return any(lines is not None and lines.coherence > _COHERENT for lines in found)


class _Lines(NamedTuple):
    """The lines that an input excites: `frequency`, Hz; `response`, acceleration over input; and their median
    `coherence`."""

    frequency: Float[np.ndarray, " f"]
    response: Complex[np.ndarray, " f"]
    coherence: float


def _excited_lines(batch: Batch, row: int) -> _Lines | None:
    """Those of a recording; None where there are too few."""
    n, rate = int(batch.lengths[row]), 1.0 / float(batch.dt[row])
    segment = min(round(_SEGMENT * rate), n)
    u, x = np.asarray(batch.u)[row, :n], np.asarray(batch.x)[row, :n]
    f, power = scipy.signal.welch(u, rate, nperseg=segment)
    _, cross = scipy.signal.csd(u, x, rate, nperseg=segment)
    _, output = scipy.signal.welch(x, rate, nperseg=segment)
    excited = (power > _EXCITED * power.max()) & (f > _LOWEST) & (f < 0.2 * rate)
    if np.count_nonzero(excited) < 5 or not np.all(output[excited] > 0.0):
        return None
    f, power, cross, output = (values[excited] for values in (f, power, cross, output))
    coherence = float(np.median(np.abs(cross) ** 2 / (power * output)))
    return _Lines(f, -((2.0 * np.pi * f) ** 2) * cross / power, coherence)


def _pair(frequency: Float[np.ndarray, " f"], response: Complex[np.ndarray, " f"]) -> Pair | None:
    try:
        found = resonances(frequency, response)
    except InputError:
        return None  # the response has no peak and no dip
    dip, peak = found.antiresonance, found.resonance
    if dip is None or peak is None or not _CLOSEST < peak / dip < _FURTHEST:
        return None
    return Pair(dip, 1.0 - (dip / peak) ** 2)
