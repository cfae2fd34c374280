"""Imposed motions, the equations of friction under them written out again, and differences of functions."""

import itertools

import numpy as np
from helpers_lugre_numpy import numbers
from helpers_plants import PLANTS
from scipy.integrate import solve_ivp

BEND = {name: float(plant.friction.Fs / plant.friction.sigma0) for name, plant in PLANTS.items()}
"""Deflection at break-away."""


def sine(amplitude, frequency, phase=0.3):
    """Position and velocity as functions of time, and no corners."""
    w = 2 * np.pi * frequency
    return lambda t: (amplitude * np.sin(w * t + phase), amplitude * w * np.cos(w * t + phase)), []


def zigzag(turns, speed):
    """From turn to turn at constant `speed`: the motion, which takes the later side of a corner, and the corners."""
    turns = np.asarray(turns, float)
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)) / speed)])

    def motion(t):
        leg = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        return np.interp(t, times, turns), speed * np.sign(np.diff(turns))[leg]

    return motion, list(times)


def reference(
    drive,
    motion,
    t,
    *,
    corners=(),
    shape=lambda x, v: 1.0,
    hardening=0.0,
    creep=(0.0, 1.0),
    slips_with="w",
    slip=lambda bend, direction: bend,
    state=(0.0, lambda v, h, bend: 0.0, lambda v, h, level: level),
):
    """Friction force and deflection at the instants `t`, the equations written out again; both sides of a corner.

    `slips_with`: the velocity with which the bristle slips, that which it sees, "w", or that of the machine, "v".
    `state`: the first value of a state, its rate (`bend`: force of the bristle over the level without it), and the
    level that it makes of the level.
    """
    _, s0, s1, s2, fc, fs, vs = numbers(drive)
    compliance, lag = creep
    begin, state_rate, own_level = state
    unit = fs / s0

    def parts(x, v, y):
        plain = (fc + (fs - fc) * np.exp(-((v / vs) ** 2))) * shape(x, v)
        level = own_level(v, y[2], plain)
        z, crept = y[:2] * unit
        spring = s0 * z * (1.0 + hardening * (s0 * z / fs) ** 2)
        crept_rate = (compliance * spring / s0 - crept) / lag
        seen = v - crept_rate
        rate = seen - abs(v if slips_with == "v" else seen) * slip(spring / level, 1.0 if v >= 0.0 else -1.0)
        return spring + s1 * rate + s2 * v, np.array(
            [rate / unit, crept_rate / unit, state_rate(v, y[2], spring / plain)]
        )

    cuts = np.unique(np.concatenate([[t[0], t[-1]], [c for c in corners if t[0] + 1e-9 < c < t[-1] - 1e-9]]))
    force, deflection, sides, y = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size), np.zeros(3)
    y[2] = begin
    for first, last in itertools.pairwise(cuts):
        inside = lambda time, a=first, b=last: np.clip(time, a + 1e-9 * (b - a), b - 1e-9 * (b - a))  # noqa: E731
        at = np.flatnonzero((t > first - 1e-9) & (t < last + 1e-9))
        solution = solve_ivp(
            lambda time, y, side=inside: parts(motion(time)[0], motion(side(time))[1], y)[1],
            (first, last),
            y,
            "LSODA",
            t_eval=np.clip(t[at], first, last),
            rtol=1e-10,
            atol=1e-12,
            max_step=(last - first) / 50,
        )
        assert solution.success
        for k, state in zip(at, solution.y.T, strict=True):
            force[k] += parts(motion(t[k])[0], motion(inside(t[k]))[1], state)[0]
            deflection[k], sides[k] = state[0] * unit, sides[k] + 1
        y = solution.y[:, -1]
    return force / sides, deflection


def worst(found, exact, scale, trim=2):
    """Largest error over `scale`, but for the samples at both ends, where the velocity is of first order only."""
    return np.max(np.abs(np.asarray(found) - exact)[trim:-trim]) / scale


AT = np.linspace(0.0, 1.0, 301)
MOTION = 1e-4 * np.sin(9.0 * AT) * (1.0 - AT) + 2e-5 * np.sin(60.0 * AT)
"""A motion of 1 s."""


def differences(function, at, step):
    one = np.eye(len(at))
    low2, low, high, high2 = (np.stack([function(at + k * step * e) for e in one]) for k in (-2, -1, 1, 2))
    return ((8.0 * (high - low) - (high2 - low2)) / (12.0 * step)).T
