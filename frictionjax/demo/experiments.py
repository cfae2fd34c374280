"""The experiments on the demo's arm: six recordings to fit, two held-out ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from frictionjax.demo.arm import Arm
from frictionjax.demo.motion import SAMPLE_RATE


@dataclass(frozen=True)
class PlannedExperiment:
    """One experiment before it is run.

    **Attributes:**

    - `name`: the stem of its file.
    - `role`: `"fit"` or `"holdout"`.
    - `loop`: `"open"` (`signal` is a voltage, V) or `"closed"` (`signal` is the position to follow, rad).
    - `signal`: voltage or reference at each sample, shape `(n,)`.
    """

    name: str
    role: Literal["fit", "holdout"]
    loop: Literal["open", "closed"]
    signal: Float[np.ndarray, " n"]


Signal = Float[np.ndarray, " n"]
"""One value at each sample."""

Corners = Sequence[tuple[float, float]]
"""Times (s) and levels."""


def _time(seconds: float) -> Signal:
    return np.arange(round(seconds * SAMPLE_RATE)) / SAMPLE_RATE


def _binary_noise(rng: np.random.Generator, seconds: float) -> Signal:
    """Random signs, a new one every other sample: power up to about 450 Hz, rms 1."""
    n = round(seconds * SAMPLE_RATE)
    return np.repeat(rng.choice([-1.0, 1.0], n // 2 + 1), 2)[:n]


def _gaussian_noise(rng: np.random.Generator, seconds: float) -> Signal:
    """Gaussian noise without power above 500 Hz, rms 1."""
    spectrum = np.fft.rfft(rng.standard_normal(round(seconds * SAMPLE_RATE)))
    n = round(seconds * SAMPLE_RATE)
    frequency = np.fft.rfftfreq(n, 1.0 / SAMPLE_RATE)
    spectrum[(frequency == 0.0) | (frequency > 500.0)] = 0.0
    signal = np.fft.irfft(spectrum, n)
    return signal / np.sqrt(np.mean(signal**2))


def _polyline(seconds: float, corners: Corners) -> Signal:
    """Straight lines through `corners`, pairs of a time (s) and a level."""
    times, levels = zip(*corners, strict=True)
    return np.interp(_time(seconds), times, levels)


def _triangles(levels: Sequence[float], rate: float, pause: float) -> Corners:
    """Corners of a line that visits `levels` in turn at `rate` per second, after a `pause` in seconds at zero."""
    corners = [(0.0, 0.0), (pause, 0.0)]
    for level in levels:
        corners.append((corners[-1][0] + abs(level - corners[-1][1]) / rate, level))
    return corners


def _sines(bursts: Sequence[tuple[float, float, int]]) -> Signal:
    """Whole periods of sines in turn; each of `bursts` is a frequency (Hz), an amplitude and a number of periods."""
    return np.concatenate([a * np.sin(2.0 * np.pi * f * _time(periods / f)) for f, a, periods in bursts])


def _moves(seconds: float, moves: Sequence[tuple[float, float, float]]) -> Signal:
    """Minimum-jerk moves from zero; each of `moves` is a distance (rad), a duration (s) and the rest after it (s)."""
    t, start, position = _time(seconds), 0.2, np.zeros(round(seconds * SAMPLE_RATE))
    for distance, duration, rest in moves:
        s = np.clip((t - start) / duration, 0.0, 1.0)
        position += distance * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        start += duration + rest
    return position


def _sweep(seconds: float, low: float, high: float, wide: float, narrow: float) -> Signal:
    """A sine whose frequency (Hz) rises and whose amplitude (rad) falls, both exponentially."""
    t = _time(seconds)
    growth = np.log(high / low) / seconds
    phase = 2.0 * np.pi * low * np.expm1(growth * t) / growth
    return wide * (narrow / wide) ** (t / seconds) * np.sin(phase)


def plan(arm: Arm, rng: np.random.Generator) -> tuple[PlannedExperiment, ...]:
    """The eight experiments, designed from a rough knowledge of the break-away torque.

    **Arguments:**

    - `arm`: the machine; only its motor constant and its static friction are used, to scale the voltages.
    - `rng`: source of the two noise signals.

    **Returns:** the experiments in the order in which they are run.
    """
    volt = arm.Fs / arm.motor_constant  # breaks the arm away
    ramps = [
        (0.0, 0.0),
        (0.1, 0.0),
        (1.1, 1.08),
        (1.25, 0.0),
        (1.4, -0.35),
        (1.55, 0.0),
        (1.7, 0.0),
        (2.45, -1.1),
    ]
    ramps += [
        (2.6, 0.0),
        (2.75, 0.4),
        (2.9, 0.0),
        (3.05, 0.0),
        (3.55, 1.12),
        (3.7, 0.0),
        (3.85, -0.5),
        (4.0, 0.0),
    ]
    ramps += [(4.15, 0.0), (5.05, -1.08), (5.2, 0.0), (5.35, 0.3), (5.5, 0.0), (5.9, 0.0)]
    sines = [(1.4, level, 2) for level in (0.3, 0.5, 0.7, 0.9)]
    moves = [(0.3, 0.4, 0.3), (-0.3, 0.25, 0.3), (0.05, 0.4, 0.25), (-0.07, 0.9, 0.3)]
    moves += [(0.4, 0.4, 0.3), (-0.5, 0.5, 0.35), (0.02, 0.5, 0.3), (0.1, 0.6, 0.2)]
    nested = [0.85, -0.85, 0.5, -0.5, 0.25, -0.25, 0.25, -0.5, 0.85, -0.75, 0.4, 0.1, 0.6, -0.2, 0.75, 0.0]
    loops = _polyline(4.0, _triangles(nested, 4.4, 0.2))
    others = [(-0.2, 0.3, 0.35), (0.08, 0.6, 0.25), (0.45, 0.4, 0.35), (-0.04, 0.7, 0.25), (-0.35, 0.45, 0.3)]
    others += [(0.15, 1.0, 0.3), (0.01, 0.3, 0.3)]
    return (
        PlannedExperiment("noise_small", "fit", "open", 0.12 * volt * _binary_noise(rng, 6.0)),
        PlannedExperiment("noise_large", "fit", "open", 0.35 * volt * _gaussian_noise(rng, 6.0)),
        PlannedExperiment("breakaway", "fit", "open", volt * _polyline(6.0, ramps)),
        PlannedExperiment("stick_sine", "fit", "open", volt * _sines(sines)),
        PlannedExperiment("moves", "fit", "closed", _moves(6.0, moves)),
        PlannedExperiment("sweep", "fit", "closed", _sweep(6.0, 0.4, 6.0, 0.25, 0.04)),
        PlannedExperiment(
            "holdout_stick",
            "holdout",
            "open",
            volt * np.concatenate([loops, _sines([(2.5, 0.6, 2), (1.6, 0.8, 2)])]),
        ),
        PlannedExperiment("holdout_moves", "holdout", "closed", _moves(6.0, others)),
    )
