"""Periods along the stroke at which the prediction errors repeat."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.signal import find_peaks

from frictionjax.estimation.data.batch import AbstractBatch

_FEWEST = 1.25  # waves along the stroke: with fewer it is a spring or a slope
_TALLEST = 5.0  # times the median bin of the profile along the stroke: the most that one bin counts
# Samples of travel at the usual speed: shorter waves alias with the observer's own dynamics.
_SHORTEST_WAVE = 40
# Along the stroke: a sensor of 10 um a wave goes through 100 000 of them in a metre.
_BINS, _FINE_BINS = 2**12, 2**21
_ABOVE_NOISE = 10.0  # times the noise of the position: no shorter wave is seen


class Wavelengths(NamedTuple):
    """`periods` along the stroke, strongest first, position units, and among how many they were the strongest: what is
    chosen as the largest of many is to be tested as that."""

    periods: tuple[float, ...] = ()
    among: int = 1


def wavelengths(
    innovation: np.ndarray,
    speed: np.ndarray,
    batch: AbstractBatch,
    *,
    odd: bool,
    count: int = 3,
    fine: bool = False,
) -> Wavelengths:
    """Periods along the stroke at which the innovations repeat.

    Innovations of sliding samples, weighted by their block's level, are summed in bins of position (with the
    sign of the velocity for `odd`: a friction that varies); the Fourier transform of the sums is a periodogram.

    **Arguments:**

    - `innovation`, `speed`: standardised innovations and predicted velocity, shape `(r, n)`.
    - `batch`: the recordings.
    - `odd`: True for a force against the motion, False for one that does not care for its direction.
    - `count`: how many periods.
    - `fine`: look for those of a sensor, which may be far shorter and show at any speed.
    """
    power = np.asarray(batch.block_mean(jnp.asarray(innovation**2)))
    weight = np.repeat(1.0 / np.sqrt(power + 1.0), batch.block, axis=-1) * np.asarray(batch.valid)
    # Vibration in stick is fast, and goes nowhere: what counts is how far the machine gets within a block.
    travel = np.abs(speed.reshape(speed.shape[0], -1, batch.block).mean(-1))
    moving = travel >= 0.02 * max(float(np.quantile(travel, 0.999)), 1e-300)
    if not np.any(moving):
        return Wavelengths()
    usual = float(np.median(travel[moving]))
    getting_on = np.repeat(moving, batch.block, axis=-1)
    sliding = (weight > 0) & (fine | getting_on)
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
    # A place where the machine stays for long has all periods.
    most = _TALLEST * float(np.median(np.abs(profile[occupied > 0])))
    profile = np.clip(profile, -most, most)
    finer = 2 if fine else 8
    spectrum = np.abs(np.fft.rfft(profile, finer * bins))
    shortest = _SHORTEST_WAVE * usual * float(np.min(np.asarray(batch.dt)))
    if fine:
        shortest = max(4.0 * span / bins, _ABOVE_NOISE * float(np.min(np.asarray(batch.noise))))
    least = 20.0 if fine else _FEWEST
    spectrum = spectrum[: int(finer * span / shortest) + 2]
    cycles = np.arange(spectrum.size) / finer
    spectrum[(cycles < least) | (cycles > span / shortest)] = 0.0
    peaks, _ = find_peaks(spectrum)
    order = peaks[np.argsort(spectrum[peaks])[::-1]]
    chosen: list[float] = []
    for peak in order:
        period = span / cycles[peak]
        if all(abs(np.log(period / other)) > 0.1 for other in chosen):
            chosen.append(float(period))
        if len(chosen) == count:
            break
    # As many as there are waves that a stroke of this length tells apart.
    return Wavelengths(tuple(chosen), max(round(span / shortest - least), 1))
