"""The frequency axis of the map: spectrum of the innovations over that of noise seen by the observer."""

import itertools

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from frictionjax.diagnosis.evidence.judgement import Scene

_EDGES = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, np.inf])  # Hz
# The observer leaves next to nothing at low frequencies: a hundredth of the mean is added on both sides, so that
# rounding and leakage are not told as an excess.
_GROUND = 0.01


class Bands(eqx.Module):
    """Frequency bands and what noise alone leaves in them.

    **Attributes:** `labels`; `lines`, the number of spectral lines in each, and `null`, the power that the floor leaves
    there, a line's mean being 1, shape `(b,)`; `band` of each line of each recording, and their `lengths` in samples.
    """

    labels: tuple[str, ...] = eqx.field(static=True)
    lines: Int[np.ndarray, " b"]
    null: Float[np.ndarray, " b"]
    band: tuple[np.ndarray, ...]
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
    """The bands that the recordings of the `scene` reach.

    Noise of the sensor is seen as |(1 - q)/(1 - p q)|^4, a white force on a free mass as 1/|1 - p q|^4, each of mean 1;
    of the `floor` of each sample the sensor has 1 and the force the rest.
    """
    null, bands = np.zeros(len(_EDGES) - 1), []
    for row, length in enumerate(scene.batch.lengths):
        dt = float(scene.batch.dt[row])
        frequency = np.fft.rfftfreq(length, dt)[1:]
        q = np.exp(-2j * np.pi * frequency * dt)
        seen = np.abs(1.0 - np.exp(-2.0 * np.pi * min(scene.bandwidth, 0.1 / dt) * dt) * q) ** -4.0
        sensor = np.abs(1.0 - q) ** 4 * seen
        if scene.bandwidth == 0.0:  # no observer: all noise of an imposed motion's force is white
            seen = sensor = np.ones(frequency.size)
        part = float(np.mean(1.0 / floor[row, :length]))
        mixed = part * sensor / sensor.mean() + (1.0 - part) * seen / seen.mean()
        band = np.digitize(frequency, _EDGES) - 1
        null += np.bincount(band, mixed + _GROUND, minlength=null.size)
        bands.append(band)
    # Bands beyond the sampling of every recording hold nothing; they are the last ones.
    used = int(np.flatnonzero(null > 0)[-1]) + 1
    labels = tuple(
        f"{low:.3g} to {high:.3g} Hz" if np.isfinite(high) else f"above {low:.3g} Hz"
        for low, high in itertools.pairwise(_EDGES[: used + 1].tolist())
    )
    lines = np.bincount(np.concatenate(bands), minlength=used)
    return Bands(labels, lines, null[:used], tuple(bands), tuple(int(n) for n in scene.batch.lengths))
