"""References of closed loops as drives and robots make them: moves along trapezoids of speed, slow reversals, ramps.

All return one value per sample, shape `(n,)`, and begin in the origin at rest.
"""

from __future__ import annotations

import numpy as np

from .plants import Plant, log_uniform

Rng = np.random.Generator


def _smooth(reference: np.ndarray, time: float, rate: float) -> np.ndarray:
    """The running mean of a reference over `time`, which begins at its first value: limits its next derivative."""
    width = max(round(time * rate), 1)
    padded = np.concatenate([np.full(width - 1, reference[0]), reference])
    total = np.cumsum(np.concatenate([[0.0], padded]))
    return (total[width:] - total[:-width]) / width


def _trapezoid(t: np.ndarray, length: float, speed: float, acceleration: float) -> tuple[np.ndarray, float]:
    """Way along a move of `length` from t = 0 on whose speed is a trapezoid, and how long it lasts."""
    peak = min(speed, float(np.sqrt(length * acceleration)))
    rise = peak / acceleration
    lasts = length / peak + rise
    t = np.clip(t, 0.0, lasts)
    half = 0.5 * acceleration
    up, down = half * np.minimum(t, rise) ** 2, half * np.minimum(lasts - t, rise) ** 2
    cruise = peak * np.clip(t - rise, 0.0, lasts - 2 * rise)
    return up + cruise + half * rise**2 - down, lasts


def _moves(rng: Rng, plant: Plant, duration: float, rate: float, jerk: float, slowest: float) -> np.ndarray:
    """Moves between random places with dwells; `jerk` is the time over which acceleration rises, s."""
    t = np.arange(round(duration * rate)) / rate
    reference, here, clock = np.zeros_like(t), 0.0, rng.uniform(0.2, 0.5)
    first = True
    while clock < duration:
        target = rng.uniform(-1.0, 1.0) * plant.stroke
        if abs(target - here) < 0.1 * plant.stroke:
            continue
        # No move takes more than a third of the recording, and the first uses what the drive has.
        share = 1.0 if first else log_uniform(rng, slowest, 1.0)
        speed = max(share * plant.top_speed, 3.0 * abs(target - here) / duration)
        way, lasts = _trapezoid(
            t - clock, abs(target - here), speed, plant.acceleration * rng.uniform(0.5, 1.0)
        )
        reference += np.sign(target - here) * way
        here, clock, first = target, clock + lasts + log_uniform(rng, 0.1, 0.8), False
    return _smooth(reference, jerk, rate)


def trapezoid_moves(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Moves with a trapezoid of speed, only just rounded."""
    return _moves(rng, plant, duration, rate, rng.uniform(0.002, 0.01), 0.05)


def s_curve_moves(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Moves whose acceleration rises and falls in a time between 30 and 120 ms."""
    return _moves(rng, plant, duration, rate, rng.uniform(0.03, 0.12), 0.05)


def either_moves(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Moves of the one sort or the other, at speeds down to a fiftieth of the largest."""
    jerk = rng.uniform(0.002, 0.01) if rng.random() < 0.5 else rng.uniform(0.03, 0.12)
    return _moves(rng, plant, duration, rate, jerk, 0.02)


def slow_reversals(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """To and fro at constant slow speeds, each held for 0.4 to 2 s."""
    n = round(duration * rate)
    speeds, here, side = np.zeros(n), 0.0, float(rng.choice([-1.0, 1.0]))
    at = round(0.3 * rate)
    while at < n:
        speed = plant.top_speed * log_uniform(rng, 0.01, 0.2)
        lasts = min(rng.uniform(0.4, 2.0), 0.8 * plant.stroke / speed)
        if abs(here + side * speed * lasts) > 0.9 * plant.stroke:
            side = -side  # a leg that would leave the stroke goes the other way
        samples = round(lasts * rate)
        speeds[at : at + samples] = side * speed
        here, side, at = here + side * speed * samples / rate, -side, at + samples
    speeds = _smooth(speeds, rng.uniform(0.02, 0.08), rate)
    return np.concatenate([[0.0], np.cumsum(speeds[:-1])]) / rate


def slow_sines(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Two or three slow sines, one after the other, each a whole number of periods."""
    n = round(duration * rate)
    parts = int(rng.integers(2, 4))
    pieces = [np.zeros(round(0.3 * rate))]
    for part in range(parts):
        samples = (n - pieces[0].size) // parts
        t = np.arange(samples) / rate
        periods = max(round(log_uniform(rng, 0.15, 0.8) * samples / rate), 1)
        omega = 2 * np.pi * periods * rate / samples
        # The largest of them sweeps the stroke unless it would be too fast.
        share = 0.9 if part == 0 else log_uniform(rng, 0.05, 0.9)
        size = min(share * plant.stroke, 0.6 * plant.top_speed / omega, 0.6 * plant.acceleration / omega**2)
        pieces.append(rng.choice([-1.0, 1.0]) * size * np.sin(omega * t))
    joined = np.concatenate(pieces)
    return _smooth(np.pad(joined, (0, max(n - joined.size, 0)))[:n], 0.1, rate)


def speed_ramps(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Speed that rises and falls along straight lines, in both directions, to tops that differ."""
    n = round(duration * rate)
    speeds, side, at = np.zeros(n), float(rng.choice([-1.0, 1.0])), round(0.3 * rate)
    while at < n:
        top = plant.top_speed * log_uniform(rng, 0.02, 0.6)
        # Up and down again within the stroke, from where the last pair of ramps came back to.
        half = min(rng.uniform(0.4, 1.5), 0.8 * plant.stroke / top)
        samples = max(round(2 * half * rate), 2)
        ramp = side * top * (1.0 - np.abs(np.linspace(-1.0, 1.0, samples)))
        both = np.concatenate([ramp, -ramp])
        speeds[at : at + both.size] = both[: n - at]
        at, side = at + both.size, -side
    speeds = _smooth(speeds, 0.01, rate)
    return np.concatenate([[0.0], np.cumsum(speeds[:-1])]) / rate


def position_chirp(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """A sine whose frequency rises to some hertz, its amplitude bounded by what the drive can do."""
    t = np.arange(round(duration * rate)) / rate
    low, high = log_uniform(rng, 0.2, 0.4), log_uniform(rng, 2.0, 5.0)
    growth = np.log(high / low) / duration
    omega = 2 * np.pi * low * np.exp(growth * t)
    phase = 2 * np.pi * low * (np.exp(growth * t) - 1.0) / growth
    most = np.minimum(0.5 * plant.top_speed / omega, 0.2 * plant.acceleration / omega**2)
    return np.minimum(0.4 * plant.stroke, most) * np.clip(t / 0.5, 0.0, 1.0) * np.sin(phase)


def torque_ramps(rng: Rng, plant: Plant, duration: float, rate: float) -> np.ndarray:
    """Input (not a reference): slow ramps to and fro whose tops rise towards break-away, the last one past it."""
    count = int(rng.integers(3, 6))
    tops = np.append(np.sort(rng.uniform(0.3, 0.85, count)), rng.uniform(1.08, 1.2))
    turns = np.ravel(np.column_stack([tops * (-1.0) ** np.arange(count + 1), np.zeros(count + 1)]))
    knots = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(np.append(0.0, turns))))])
    t = np.arange(round(duration * rate)) / rate
    side = float(rng.choice([-1.0, 1.0])) * plant.Fs / plant.motor_constant
    return side * np.interp(t, knots / knots[-1] * duration, np.append(0.0, turns))
