"""One experiment on one machine: controller, noise, and what only the author of a benchmark may see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from .experiments import RATE, Experiment
from .foresight import ahead, watch
from .kernel import WORTH, simulate, worth_of
from .knobs import SLOW_STATES, STATE_DTYPE, rest
from .plants import Plant, log_uniform
from .streams import stream

SUBSTEPS = 32
"""Substeps of a sample at 2 kHz; other rates keep the length of the substep, and at least four of them."""
SETTLE = 1.0
STARTS = 40  # predictions that begin within one horizon; each goes on until the next one has come as far
_WATCH = 50.0  # Hz, bandwidth of the observer whose states the predictions start from


class Hidden(NamedTuple):
    """What no diagnosis sees, shape `(n,)`: what the sensor would show without noise and rounding (`clean`), and what
    its own model, watching the measurement, would have predicted a horizon before (`ahead`; NaN where it was not
    asked); the same of `m` other models, shape `(m, n)` (`rivals`)."""

    clean: np.ndarray
    ahead: np.ndarray
    rivals: np.ndarray


def _gains(rng: np.random.Generator, plant: Plant, trip: float) -> np.ndarray:
    """PD controller tuned on the inertia, as on the shop floor, with a bandwidth of some hertz."""
    w = 2 * np.pi * rng.uniform(4.5, 8.0)
    kp = plant.J * w**2 / plant.motor_constant
    kd = 2 * rng.uniform(0.7, 1.0) * plant.J * w / plant.motor_constant
    return np.array([kp, kd, rng.uniform(2e-3, 4e-3), 6.0 * plant.Fs / plant.motor_constant, trip])


def _colour(rng: np.random.Generator, white: np.ndarray, rate: float) -> np.ndarray:
    """Unit noise of which a part is low-passed at a corner between 5 and 200 Hz, from `white` noise of shape `(n,)`."""
    share, corner = rng.uniform(0.4, 0.9), log_uniform(rng, 5.0, 200.0)
    pole = np.exp(-2 * np.pi * corner / rate)
    slow = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(white.size))
    return np.sqrt(1.0 - share) * white + np.sqrt(share) * np.asarray(slow)


def record(
    experiment: Experiment,
    plant: Plant,
    knobs: np.ndarray,
    carried: dict[str, float],
    seed: int,
    substeps: int = SUBSTEPS,
    *,
    coloured: bool = False,
    horizon: float = 0.0,
    rivals: Sequence[np.ndarray] = (),
    starts: int = STARTS,
) -> tuple[dict, dict[str, float], Hidden]:
    """Simulate one experiment; returns the recording, the slow states at its end, and what is hidden.

    `substeps` is at 2 kHz; `coloured` makes the position noise coloured; with a `horizon` (s) the machine predicts, and
    so do models with other knobs (`rivals`), from `starts` states within one horizon.
    """
    rng = stream(seed, "noise", experiment.name)
    gains = _gains(stream(seed, "controller"), plant, experiment.trip)
    control = experiment.control
    if control is not None:
        gains = control.gains
        feed = control.feed(plant, experiment.command, experiment.rate)
    else:
        gains = np.append(gains, 0.0)
        feed = np.zeros(experiment.command.size)
    memory = np.zeros(4)
    state = rest()
    for name, value in carried.items():
        state[name] = value
    rate, n, start = experiment.rate, experiment.command.size, experiment.start_time
    dt, substeps = 1.0 / rate, max(round(substeps * RATE / rate), 4)
    steps_ahead = round(horizon * rate)
    every = max(steps_ahead // starts, 1) if steps_ahead else 0

    def run(
        closed: bool, command: np.ndarray, feed: np.ndarray, quiet: bool, begin: float
    ) -> tuple[np.ndarray, ...]:
        count = command.size
        scale = 0.0 if quiet else 1.0
        noise = rng.standard_normal(count)
        if coloured and not quiet:
            noise = _colour(stream(seed, "colour", experiment.name), noise, rate)
        noise = scale * plant.sensor_noise * plant.encoder_step * noise
        push = scale * plant.process_noise * plant.Fc * rng.standard_normal(count)
        slow = scale * rng.standard_normal((count, 2))
        step = plant.encoder_step
        return simulate(
            knobs, state, closed, command, feed, gains, memory, step, noise, push, slow, begin, dt, substeps
        )

    # Constant forces are there before the recording starts: let the machine settle under them, held by its loop.
    before = np.zeros(round(SETTLE * rate))
    run(control is not None, before, before + (feed[0] if control is not None else 0.0), True, start - SETTLE)
    first, rested = state.copy(), float(memory[WORTH])
    u, y, clean, worth = run(experiment.loop == "closed", experiment.command, feed, False, start)

    def foreseen(model: np.ndarray, worth: np.ndarray) -> np.ndarray:
        if not every:
            return np.full(n, np.nan)
        kept = np.zeros(-(-n // every), STATE_DTYPE)
        pole = np.exp(-2 * np.pi * min(_WATCH, 0.1 * rate) * dt)
        watching = np.array([1.0 - pole**2, (1.0 - pole) ** 2 / dt])
        watch(model, first.copy(), y, worth, rested, watching, start, dt, substeps, kept, every)
        return ahead(model, kept, every, worth, rested, steps_ahead, every, start, dt, substeps)

    others = [foreseen(model, worth_of(model, first.copy(), u, start, dt)) for model in rivals]
    recording = {
        "name": experiment.name,
        "role": experiment.role,
        "loop": experiment.loop,
        "start_time": start,
        "sample_rate": rate,
        "t": np.arange(n) * dt,
        "u": u,
        "x": y,
    }
    inside = Hidden(clean, foreseen(knobs, worth), np.array(others).reshape(-1, n))
    return recording, {name: float(state[name][0]) for name in SLOW_STATES}, inside
