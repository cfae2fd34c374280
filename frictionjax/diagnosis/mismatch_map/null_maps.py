"""The map under the null hypothesis: maps of simulated innovations that are at the noise floor.

Under a true model the spectrum of the innovations is known: the sensor's noise through the observer and, where the
floor is higher, a white force besides. The noise level by which they are standardised is estimated from the same noise,
and is so here. Each draw gives one map, and a bin is compared with the largest statistic of all bins in each (max-T,
Westfall and Young 1993), so that the chosen level is the probability of one or more false bins anywhere in the map.
"""

import functools
from collections.abc import Callable, Iterable

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Float

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.mismatch_map.bin_power import Tally
from frictionjax.diagnosis.mismatch_map.frequency_bands import Bands
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import white_level
from frictionjax.simulation import innovation_gain, observer_gains

DRAWS = 199
_TOGETHER = 8  # draws at a time
_SEED = 20020301
_WIDEST = 3.0
"""Largest factor by which a standard error may exceed that of white noise."""


class Chance(eqx.Module):
    """Distribution of the map under the null hypothesis.

    **Attributes:** `spread`, the standard deviation of the logarithm of each bin's power, shape `(b,)` (the bins of the
    tally, then the bands), and `largest`, the largest statistic of each drawn map, shape `(draws,)`.
    """

    spread: Float[np.ndarray, " b"]
    largest: Float[np.ndarray, " draws"]

    def p_values(self, statistic: Float[np.ndarray, " b"]) -> Float[np.ndarray, " b"]:
        """Family-wise p-value of each bin: the share of the maps, the observed one included, whose largest statistic
        reaches its `statistic`."""
        reached = np.sum(self.largest[None, :] >= statistic[:, None], axis=1)
        return (1.0 + reached) / (1.0 + self.largest.size)


def statistic_of(
    power: Float[np.ndarray, "b ..."], own: Float[np.ndarray, "b ..."], spread: Float[np.ndarray, "b ..."]
) -> Float[np.ndarray, "b ..."]:
    """How far each bin's power lies above its floor: log P over its standard error from clusters, which is bounded
    between that under the null hypothesis and three times that.

    An effect in one cluster of ten raises the scatter as much as the mean: without the upper bound and the logarithm,
    a clear burst would not be significant.

    **Arguments:**

    - `power`: over the floor.
    - `own`: relative standard error of `power` from clusters.
    - `spread`: standard deviation of log P under the floor.
    """
    error = np.clip(own, spread, _WIDEST * spread)
    return np.log(np.maximum(power, 1e-300)) / np.maximum(error, 1e-12)


class _NoiseFilter(eqx.Module):
    """From noise to the innovations of one recording's observer: `zeros` of the filter for the sensor's noise, its
    `poles`, and the gains for the sensor's noise and for a white force on a free mass."""

    zeros: Float[np.ndarray, " z"]
    poles: Float[np.ndarray, " p"]
    sensor_gain: float
    force_gain: float


def draw_innovations(
    scene: Scene, floor: Float[np.ndarray, "r n"], count: int, rng: np.random.Generator
) -> Float[np.ndarray, "k r n"]:
    """Simulated standardised innovations of a true model for the `scene`, over the root of their `floor`: `count` draws
    by `rng`, shape `(k, r, n)`; zero where nothing is scored. In single precision: only their powers are needed."""
    scored = (np.asarray(scene.batch.valid) > 0).astype(np.float32)
    drawn = np.zeros((count, *scored.shape), np.float32)
    for row, length in enumerate(scene.batch.lengths):
        dt = float(scene.batch.dt[row])
        bandwidth = 0.0 if scene.white[row] else float(scene.bandwidth[row])
        noise_filter = _noise_filter(bandwidth, dt, bool(scene.batch.integrated[row]))
        noise = rng.standard_normal((count, length), np.float32)
        levels = np.array([white_level(lane) for lane in noise], np.float32)
        zeros = noise_filter.zeros / np.float32(noise_filter.sensor_gain)
        e = scipy.signal.lfilter(zeros, noise_filter.poles, noise) / levels[:, None]
        own = floor[row, :length].astype(np.float32)
        if np.any(own > 1.0):
            push = rng.standard_normal((count, length), np.float32)
            unit = np.ones(1, np.float32) / np.float32(noise_filter.force_gain)
            force = scipy.signal.lfilter(unit, noise_filter.poles, push)
            e = (e + np.sqrt(own - 1.0) * force) / np.sqrt(own)
        drawn[:, row, :length] = e * scored[row, :length]
    return drawn


@functools.cache
def _noise_filter(bandwidth: float, dt: float, integrated: bool) -> _NoiseFilter:
    if bandwidth == 0.0:  # white: of a Kalman filter; of an imposed motion's force, the noise itself
        return _NoiseFilter(np.ones(1, np.float32), np.ones(1, np.float32), 1.0, 1.0)
    pole = float(np.exp(-2.0 * np.pi * bandwidth * dt))
    poles = np.array([1.0, -2.0 * pole, pole**2], np.float32)
    # The norm of 1/(1 - p q)^2, from force to innovation.
    norm = float(np.sqrt((1.0 + pole**2) / (1.0 - pole**2) ** 3))
    zeros = np.sqrt(2.0) * np.array([1.0, -1.0]) if integrated else np.array([1.0, -2.0, 1.0])
    return _NoiseFilter(
        zeros.astype(np.float32),
        poles,
        float(innovation_gain(observer_gains(bandwidth, dt), integrated)),
        norm,
    )


def chance_of(
    tally: Tally,
    bands: Bands,
    scene: Scene,
    floor: Float[np.ndarray, "r n"],
    draws: int = DRAWS,
    mapping: Callable[..., Iterable] = map,
    *,
    rule: Rule = Rule(),
) -> Chance:
    """Draw the maps under the null hypothesis; the same ones each time.

    **Arguments:**

    - `tally`, `bands`: the bins.
    - `scene`: the recordings.
    - `floor`: power that a true model leaves at each sample, shape `(r, n)`.
    - `draws`: how many maps.
    - `mapping`: as `map`; that of an executor draws in parallel.
    - `rule`: how many clusters a standard error needs.
    """

    def draw(number: int) -> tuple[Float[np.ndarray, "b k"], Float[np.ndarray, "b k"]]:
        rng = np.random.default_rng((_SEED, number))
        e = draw_innovations(scene, floor, min(_TOGETHER, draws), rng)
        power, scatter = tally.powers(tally.sums(e**2), rule)
        empty = np.zeros((bands.null.size, e.shape[0]))
        return np.concatenate([power, bands.powers(e)]), np.concatenate([scatter, empty])

    parts = list(mapping(draw, range(-(-draws // min(_TOGETHER, draws)))))
    power, scatter = (np.concatenate(part, axis=1)[:, :draws] for part in zip(*parts, strict=True))
    spread = np.std(np.log(np.maximum(power, 1e-300)), axis=1)
    return Chance(spread, np.max(statistic_of(power, scatter, spread[:, None]), axis=0))
