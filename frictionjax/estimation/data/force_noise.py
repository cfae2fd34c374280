"""The noise of measured friction forces: of the sensor, and the cycle-to-cycle scatter of friction itself."""

import numpy as np
from jaxtyping import Float

from frictionjax.estimation.data.batch import block_of, noise_level, white_level
from frictionjax.recordings import Recording

# Of the force's standard deviation: no load cell is straighter and freer of hysteresis than this (0.05 to 0.2 % are
# sold), and many are filtered until their own noise is far below it.
_LEAST_NOISE = 2e-3
_AT_REST = 4.0  # standard deviations of the position's noise: a block that moves no further stands still
_FEWEST_BLOCKS = 20  # blocks that determine a noise level
# Of the stroke: a motion that comes back as near as this for most of the time is periodic.
_PERIODIC = 0.01
_MOST_OF_THE_TIME = 0.75


def force_noise_levels(recordings: tuple[Recording, ...]) -> list[float]:
    """Standard deviation of the noise of the force of each of the motion-driven `recordings`, force units.

    The largest of the sensor's noise (`sensor_noise`), the cycle-to-cycle scatter of friction (`unrepeated`, of all
    recordings together: it is one machine), and 0.2 % of all forces' standard deviation.
    """
    least = _LEAST_NOISE * float(
        np.std(np.concatenate([np.asarray(r.force, dtype=float) for r in recordings]))
    )
    return [max(sensor_noise(r), least, unrepeated(recordings)) for r in recordings]


def sensor_noise(recording: Recording) -> float:
    """Standard deviation of the noise of the sensor of force, force units.

    The larger of two. Fourth differences are blind to all smooth change, and so to much of the noise of a sensor that
    is filtered. Blocks in which the machine stands still have that too: nothing else changes a friction force there
    but a drift, which is subtracted.
    """
    force, moved = _blocks((recording,), np.asarray(recording.force, dtype=float))
    still = force[moved <= _AT_REST * noise_level(recording)]
    if len(still) < _FEWEST_BLOCKS:
        return white_level(np.asarray(recording.force, dtype=float))
    t = np.arange(force.shape[1]) - 0.5 * (force.shape[1] - 1)
    rested = still - np.mean(still, axis=1, keepdims=True)
    rested -= np.outer(rested @ t / (t @ t), t)
    level = np.sqrt(np.median(np.sum(rested**2, axis=1) / (t.size - 2)))
    return max(white_level(np.asarray(recording.force, dtype=float)), float(level))


def unrepeated(recordings: tuple[Recording, ...]) -> float:
    """Scatter of friction from cycle to cycle of a periodic motion, force units: median standard deviation of the
    blocks that move. 0 where the motion is not periodic.

    No model of friction, whatever it may be, can predict more. A drift over many cycles does not count.
    """
    rate = recordings[0].sample_rate
    same_rate = tuple(r for r in recordings if r.sample_rate == rate)
    x = np.concatenate([r.x for r in same_rate])
    period = _period(x)
    if period is None:
        return 0.0
    force = np.concatenate([np.asarray(r.force, dtype=float) for r in same_rate])
    changes, moved = _blocks(same_rate, force[period:] - force[:-period])
    moving = moved[: len(changes)] > _AT_REST * max(noise_level(r) for r in same_rate)
    if np.sum(moving) < _FEWEST_BLOCKS:
        return 0.0
    return float(np.sqrt(np.median(np.mean(changes[moving] ** 2, axis=1)) / 2.0))


def _blocks(
    recordings: tuple[Recording, ...], values: Float[np.ndarray, " samples"]
) -> tuple[Float[np.ndarray, "b n"], Float[np.ndarray, " b"]]:
    """`values` of the recordings one after the other in blocks, shape `(b, n)`, and how far the position moves in each
    of these, shape `(b,)`."""
    block = block_of(recordings)
    count = values.size // block
    x = np.concatenate([r.x for r in recordings])[: count * block].reshape(count, block)
    return values[: count * block].reshape(count, block), np.ptp(x, axis=1)


def _period(x: Float[np.ndarray, " n"]) -> int | None:
    """Period of the motion, samples; None where it is not periodic."""
    centred = x - np.mean(x)
    power = np.abs(np.fft.rfft(centred, 2 * x.size)) ** 2
    correlation = np.fft.irfft(power)[: x.size // 2] / (x.size - np.arange(x.size // 2))
    negative = np.flatnonzero(correlation < 0.0)
    if not negative.size or negative[0] + 1 >= correlation.size:
        return None
    period = int(negative[0] + np.argmax(correlation[negative[0] :]))
    away = np.quantile(np.abs(x[period:] - x[:-period]), _MOST_OF_THE_TIME)
    return period if away < _PERIODIC * float(np.ptp(x)) else None
