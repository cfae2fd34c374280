"""The frequency axis of the map: spectrum of the innovations over that of noise through the observer."""

import itertools

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from frictionjax.diagnosis.evidence.judgement import Scene

_EDGES = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, np.inf])  # Hz
# Innovations of noise have almost no power at low frequencies: a hundredth of the mean is added to both spectra, so
# that rounding and leakage do not count as an excess.
_GROUND = 0.01


class Bands(eqx.Module):
    """Frequency bands and the power of noise alone in them.

    **Attributes:** `labels`; `lines`, the number of spectral lines in each, and `null`, the power of the
    floor there, in units of the mean of a line, shape `(b,)`; `band` of each line of each recording, and the `lengths`
    of the recordings in samples.
    """

    labels: tuple[str, ...] = eqx.field(static=True)
    lines: Int[np.ndarray, " b"]
    null: Float[np.ndarray, " b"]
    band: tuple[Int[np.ndarray, " _"], ...]
    lengths: tuple[int, ...] = eqx.field(static=True)

    def powers(self, e: Float[np.ndarray, "k r n"]) -> Float[np.ndarray, "b k"]:
        """Power of each band over its null, for innovations `e` over the root of their floor, shape `(k, r, n)`."""
        sums = np.zeros((self.null.size, e.shape[0]))
        for row, (length, band) in enumerate(zip(self.lengths, self.band, strict=True)):
            window = (np.hanning(length) * np.sqrt(8.0 / 3.0)).astype(e.dtype)
            lines = np.abs(np.fft.rfft(window * e[:, row, :length])[:, 1:]) ** 2 / length + _GROUND
            for lane, spectrum in enumerate(lines):
                sums[:, lane] += np.bincount(band, spectrum, minlength=self.null.size)
        return sums / self.null[:, None]


def bands_of(scene: Scene, floor: Float[np.ndarray, "r n"]) -> Bands:
    """The bands below the Nyquist frequency of the recordings of the `scene`.

    In the innovations the sensor's noise has the spectrum |(1 - q)/(1 - p q)|^4, that of an integrated velocity
    |1 - q|^2/|1 - p q|^4, and a white force on a free mass 1/|1 - p q|^4, each of mean 1. Of the `floor` of each
    sample, 1 is the sensor's noise and the rest the force.
    """
    null, bands = np.zeros(len(_EDGES) - 1), []
    for row, length in enumerate(scene.batch.lengths):
        dt, bandwidth = float(scene.batch.dt[row]), float(scene.bandwidth[row])
        frequency = np.fft.rfftfreq(length, dt)[1:]
        q = np.exp(-2j * np.pi * frequency * dt)
        force = np.abs(1.0 - np.exp(-2.0 * np.pi * bandwidth * dt) * q) ** -4.0
        sensor = np.abs(1.0 - q) ** (2 if scene.batch.integrated[row] else 4) * force
        if scene.white[row]:  # of a Kalman filter, and all noise of an imposed motion's force
            force = sensor = np.ones(frequency.size)
        part = float(np.mean(1.0 / floor[row, :length]))
        mixed = part * sensor / sensor.mean() + (1.0 - part) * force / force.mean()
        band = np.digitize(frequency, _EDGES) - 1
        null += np.bincount(band, mixed + _GROUND, minlength=null.size)
        bands.append(band)
    # Bands above the Nyquist frequency of every recording are empty; they are the last ones.
    used = int(np.flatnonzero(null > 0)[-1]) + 1
    labels = tuple(
        f"{low:.3g} to {high:.3g} Hz" if np.isfinite(high) else f"above {low:.3g} Hz"
        for low, high in itertools.pairwise(_EDGES[: used + 1].tolist())
    )
    lines = np.bincount(np.concatenate(bands), minlength=used)
    return Bands(labels, lines, null[:used], tuple(bands), tuple(int(n) for n in scene.batch.lengths))
