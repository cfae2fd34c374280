"""Periods along the stroke with which the innovations repeat."""

from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from frictionjax.diagnosis.effort import Effort
from frictionjax.estimation.data.batch import AbstractBatch

_TALLEST = 5.0  # times the median of the profile along the stroke, at which each of its bins is clipped
# Samples of travel at the usual speed: shorter waves alias with the observer's own dynamics.
_SHORTEST_WAVE = 40
# Along the stroke: a sensor with a period of 10 um has 100 000 of them in a metre.
_BINS, _FINE_BINS = 2**12, 2**21
_ABOVE_NOISE = 10.0  # times the noise of the position: the shortest period


class Wavelengths(NamedTuple):
    """The strongest `periods` along the stroke, strongest first, position units, and `among` how many they were chosen,
    by which their p-values are to be corrected."""

    periods: tuple[float, ...] = ()
    among: int = 1


def wavelengths(
    innovation: Float[np.ndarray, "r n"],
    speed: Float[np.ndarray, "r n"],
    batch: AbstractBatch,
    *,
    odd: bool,
    count: int = 3,
    fine: bool = False,
    effort: Effort = Effort(),
) -> Wavelengths:
    """Periods along the stroke with which the innovations repeat.

    Innovations of sliding samples, weighted by the level of their block, are summed in bins of position (with the sign
    of the velocity for `odd`: friction that varies); the Fourier transform of the sums is a periodogram.

    **Arguments:**

    - `innovation`, `speed`: standardised innovations and predicted velocity, shape `(r, n)`.
    - `batch`: the recordings.
    - `odd`: True for a force against the motion, False for one that does not depend on its direction.
    - `count`: how many periods.
    - `fine`: search for those of a sensor, which may be far shorter and appear at any speed.
    - `effort`: how many waves along the stroke are searched at least.
    """
    power = batch.block_mean(innovation**2)
    weight = np.repeat(1.0 / np.sqrt(power + 1.0), batch.block, axis=-1) * np.asarray(batch.valid)
    # Vibration in stick is fast without displacement: what counts is the mean velocity over a block.
    travel = np.abs(speed.reshape(speed.shape[0], -1, batch.block).mean(-1))
    moving = travel >= 0.02 * max(float(np.quantile(travel, 0.999)), 1e-300)
    if not np.any(moving):
        return Wavelengths()
    usual = float(np.median(travel[moving]))
    travelling = np.repeat(moving, batch.block, axis=-1)
    sliding = (weight > 0) & (fine | travelling)
    if sliding.sum() < 1000:
        return Wavelengths()
    x = np.asarray(batch.x)[sliding]
    value = (innovation * weight * (np.sign(speed) if odd else 1.0))[sliding]
    span = float(np.ptp(x))
    bins = _FINE_BINS if fine else _BINS
    place = np.minimum(((x - x.min()) / span * bins).astype(int), bins - 1)
    total = np.bincount(place, value - value.mean(), minlength=bins)
    occupied = np.bincount(place, minlength=bins)
    profile = np.where(occupied > 0, total / np.sqrt(np.maximum(occupied, 1)), 0.0)
    # A position at which the machine stays for long is a peak in the profile, with power at all periods.
    most = _TALLEST * float(np.median(np.abs(profile[occupied > 0])))
    profile = np.clip(profile, -most, most)
    finer = 2 if fine else 8
    spectrum = np.abs(np.fft.rfft(profile, finer * bins))
    shortest = _SHORTEST_WAVE * usual * float(np.min(np.asarray(batch.dt)))
    if fine:
        shortest = max(4.0 * span / bins, _ABOVE_NOISE * float(np.min(np.asarray(batch.noise))))
    least = 20.0 if fine else effort.screening.fewest_waves
    spectrum = spectrum[: int(finer * span / shortest) + 2]
    cycles = np.arange(spectrum.size) / finer
    spectrum[(cycles < least) | (cycles > span / shortest)] = 0.0
    peaks, _ = scipy.signal.find_peaks(spectrum)
    order = peaks[np.argsort(spectrum[peaks])[::-1]]
    chosen: list[float] = []
    for peak in order:
        period = span / cycles[peak]
        if all(abs(np.log(period / other)) > 0.1 for other in chosen):
            chosen.append(float(period))
        if len(chosen) == count:
            break
    # The number of periods that a stroke of this length resolves.
    return Wavelengths(tuple(chosen), max(round(span / shortest - least), 1))
