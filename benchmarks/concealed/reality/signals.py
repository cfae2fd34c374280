"""Input and reference signals, scaled to a plant. All return one value per sample."""

from __future__ import annotations

import numpy as np

from .plants import Plant, log_uniform

RATE = 2000.0
"""Samples a second unless another rate is asked for; clocks counted in samples are counted at this one."""


def _volts(plant: Plant, share: float) -> float:
    """Input that makes a given share of the static friction."""
    return share * plant.Fs / plant.motor_constant


def _time(duration: float, rate: float) -> np.ndarray:
    return np.arange(round(duration * rate)) / rate


def binary_noise(
    rng: np.random.Generator, plant: Plant, duration: float, low: float, high: float, rate: float = RATE
) -> np.ndarray:
    """Random binary input; its clock is a few samples, its level a share of break-away."""
    n = round(duration * rate)
    clock = max(round(int(rng.integers(3, 6)) * rate / RATE), 1)
    bits = rng.choice([-1.0, 1.0], n // clock + 1)
    return _volts(plant, rng.uniform(low, high)) * np.repeat(bits, clock)[:n]


def ramp(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """Slow ramp past break-away in one direction, dropped to zero at its end (or by the trip, once it runs)."""
    t = _time(duration, rate)
    side = rng.choice([-1.0, 1.0])
    top = _volts(plant, rng.uniform(1.08, 1.2))
    end = rng.uniform(0.82, 0.9) * duration
    return side * np.where(t < end, top * t / end, 0.0)


def slow_sine(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """Whole periods of a slow sine near break-away, then of a smaller one around the same mean."""
    t = _time(duration, rate)
    periods = int(rng.integers(2, 5))
    phase = np.pi * 2 * periods * (t / (duration / 2))
    large, small = rng.uniform(0.72, 0.85), rng.uniform(0.35, 0.55)
    return _volts(plant, 1.0) * np.where(t < duration / 2, large, small) * np.sin(phase)


def steps(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """Levels below break-away, each reached in 50 ms and held for 0.3 to 3 s."""
    knots_t, knots_u = [0.0, 0.2], [0.0, 0.0]
    while knots_t[-1] < duration:
        level = rng.uniform(-0.82, 0.82)
        knots_t += [knots_t[-1] + 0.05]
        knots_u += [level]
        knots_t += [knots_t[-1] + log_uniform(rng, 0.3, 3.0)]
        knots_u += [level]
    return _volts(plant, 1.0) * np.interp(_time(duration, rate), knots_t, knots_u)


def nested_triangles(
    rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE
) -> np.ndarray:
    """Triangles whose turning points nest (large, smaller, smallest, and back): closes minor hysteresis loops."""
    a, b, c = rng.uniform(0.74, 0.84), rng.uniform(0.45, 0.6), rng.uniform(0.15, 0.3)
    turns = np.array([0, a, -a, b, -b, c, -c, c, -b, b, -a, a, 0.0])
    knots = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)))])
    return _volts(plant, 1.0) * np.interp(_time(duration, rate), knots / knots[-1] * duration, turns)


def stick_multisine(
    rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE
) -> np.ndarray:
    """Sum of sines whose amplitudes fall with frequency, scaled to a peak below break-away, faded in and out."""
    t = _time(duration, rate)
    f = np.exp(rng.uniform(np.log(0.25), np.log(60.0), 24))
    a = (f / 0.5) ** -rng.uniform(0.6, 0.9)
    u = np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 2 * np.pi, f.size)) @ a
    u *= np.clip(np.minimum(t, duration - t) / 0.1, 0, 1)
    return _volts(plant, rng.uniform(0.68, 0.82)) * u / np.abs(u).max()


def _blend(r: np.ndarray) -> np.ndarray:
    r = np.clip(r, 0.0, 1.0)
    return r**3 * (10.0 - 15.0 * r + 6.0 * r * r)


def moves(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """Point-to-point moves with log-uniform top speeds and log-uniform holds, smooth to the second derivative."""
    t = _time(duration, rate)
    reference, here, clock = np.zeros_like(t), 0.0, rng.uniform(0.3, 0.6)
    strength = rng.uniform(2.0, 4.0) * plant.Fs / plant.J
    while clock < duration:
        first = clock < 0.6
        target = rng.choice([-1, 1]) * rng.uniform(0.2, 0.5) if first else rng.uniform(-1, 1)
        target *= plant.stroke
        if abs(target - here) < 0.15 * plant.stroke:
            continue
        length = abs(target - here)
        # The drive's reserve bounds the peak acceleration, 1.64 speed^2 / length; the first move uses it fully.
        share = 1.0 if first else log_uniform(rng, 0.05, 1.0)
        speed = min(share * plant.top_speed, np.sqrt(strength * length / 1.64))
        lasts = 1.875 * length / speed
        reference += (target - here) * _blend((t - clock) / lasts)
        here, clock = target, clock + lasts + log_uniform(rng, 0.05, 2.0)
    return reference


def wander(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """A few slow sines that sweep the stroke without rest, faded in."""
    t = _time(duration, rate)
    f = np.sort(log_uniform(rng, 0.8, 1.25) * np.array([0.12, 0.27, 0.45, 0.7]))
    a = np.array([1.0, 0.6, 0.35, 0.2]) * rng.uniform(0.6, 1.4, 4)
    wave = np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 2 * np.pi, 4)) @ a
    wave = (wave - wave[0]) * _blend(t / 1.5)
    return rng.uniform(0.75, 0.95) * plant.stroke * wave / np.abs(wave).max()


def constant_speeds(
    rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE
) -> np.ndarray:
    """Strokes to and fro at constant speeds between half and twenty times the Stribeck velocity, smooth turns."""
    t = _time(duration, rate)
    speeds, lasts, here, side = [0.0], [0.4], 0.0, float(rng.choice([-1.0, 1.0]))
    while sum(lasts) < duration:
        speed = min(plant.vs * log_uniform(rng, 0.5, 20.0), 0.7 * plant.top_speed)
        reach = side * rng.uniform(0.4, 0.9) * plant.stroke
        lasts.append(float(np.clip(abs(reach - here) / speed, 0.3, 2.5)))
        speeds.append(side * speed)
        here, side = here + side * speed * lasts[-1], -side
    turns = np.searchsorted(np.cumsum(lasts), t)
    raw = np.asarray(speeds)[np.minimum(turns, len(speeds) - 1)]
    width = round(0.15 * rate)
    kernel = np.hanning(width + 2)[1:-1]
    smooth = np.convolve(np.concatenate([np.zeros(width), raw]), kernel / kernel.sum())[width:][: t.size]
    return np.cumsum(smooth) / rate


def chirp(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """One sine below break-away whose frequency rises through two decades, faded in and out."""
    t = _time(duration, rate)
    low, high = log_uniform(rng, 0.4, 1.0), log_uniform(rng, 40.0, 90.0)
    growth = np.log(high / low) / duration
    wave = np.sin(2 * np.pi * low * (np.exp(growth * t) - 1.0) / growth)
    return _volts(plant, rng.uniform(0.35, 0.6)) * wave * np.clip(np.minimum(t, duration - t) / 0.2, 0, 1)


def pulses(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """Short pushes past break-away, to and fro, with rests between them."""
    n = round(duration * rate)
    u, at, side = np.zeros(n), round(0.4 * rate), float(rng.choice([-1.0, 1.0]))
    while at < n:
        width = round(rng.uniform(0.03, 0.12) * rate)
        u[at : at + width] = side * rng.uniform(1.15, 1.8)
        at, side = at + width + round(log_uniform(rng, 0.15, 1.5) * rate), -side
    return _volts(plant, 1.0) * u


def jog(rng: np.random.Generator, plant: Plant, duration: float, rate: float = RATE) -> np.ndarray:
    """An operator at the jog key: small steps of the reference to and fro, smoothed over 60 ms."""
    n = round(duration * rate)
    target, at, here = np.zeros(n), round(0.4 * rate), 0.0
    while at < n:
        move = rng.choice([-1.0, 1.0]) * plant.stroke * log_uniform(rng, 0.01, 0.3)
        here = float(np.clip(here + move, -0.8 * plant.stroke, 0.8 * plant.stroke))
        target[at:] = here
        at += round(log_uniform(rng, 0.15, 1.2) * rate)
    kernel = np.hanning(round(0.06 * rate) + 2)[1:-1]
    return np.convolve(np.concatenate([np.zeros(kernel.size), target]), kernel / kernel.sum())[kernel.size :][
        :n
    ]
