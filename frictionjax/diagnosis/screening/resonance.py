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
    inputs, positions = np.asarray(batch.u), np.asarray(batch.x)
    for row in rows:
        n, rate = int(batch.lengths[row]), 1.0 / float(batch.dt[row])
        segment = min(round(_SEGMENT * rate), n)
        u, x = inputs[row, :n], positions[row, :n]
        f, power = scipy.signal.welch(u, rate, nperseg=segment)
        _, cross = scipy.signal.csd(u, x, rate, nperseg=segment)
        _, output = scipy.signal.welch(x, rate, nperseg=segment)
        excited = (power > _EXCITED * power.max()) & (f > _LOWEST) & (f < 0.2 * rate)
        if np.count_nonzero(excited) < 5 or not np.all(output[excited] > 0.0):
            continue
        coherence = float(np.median(np.abs(cross[excited]) ** 2 / (power[excited] * output[excited])))
        found = _pair(f[excited], -((2.0 * np.pi * f[excited]) ** 2) * cross[excited] / power[excited])
        if coherence > _COHERENT and found is not None and (best is None or coherence > best[0]):
            best = coherence, found
    return best[1] if best is not None else None


def _pair(frequency: Float[np.ndarray, " f"], response: Complex[np.ndarray, " f"]) -> Pair | None:
    try:
        found = resonances(frequency, response)
    except InputError:
        return None  # the response has no peak and no dip
    dip, peak = found.antiresonance, found.resonance
    if dip is None or peak is None or not _CLOSEST < peak / dip < _FURTHEST:
        return None
    return Pair(dip, 1.0 - (dip / peak) ** 2)
