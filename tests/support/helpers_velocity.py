"""A servo drive that logs torque and speed, no position."""

import numpy as np

from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Recording
from frictionjax.recordings.integral import integral_of
from frictionjax.simulation import simulate

RATE, OFFSET, NOISE = 1000.0, 0.03, 0.02
"""Hz; offset and noise of the speed, rad/s: the noise is 0.4 of the Stribeck velocity."""
FRICTION = {"sigma0": 3000.0, "sigma1": 3.0, "sigma2": 0.05, "Fc": 0.8, "Fs": 1.0, "vs": 0.05}
INERTIA = 0.02
DRIVE = Drive(INERTIA, LuGre(**FRICTION), 1.0)
T = np.arange(8000) / RATE


def _waves(*parts):
    return sum(size * np.sin(2.0 * np.pi * frequency * T + phase) for size, frequency, phase in parts)


STEPS = 1.5 * np.sign(_waves((1.0, 0.7, 0.0))) * _waves((1.0, 0.11, 0.0)) ** 2
INPUTS = {
    "sine": _waves((1.6, 0.5, 0.0), (0.5, 1.3, 1.0)),
    "ramps": np.interp(T, np.arange(9.0), [0.0, 1.3, 0.0, -1.4, 0.0, 1.9, -1.9, 0.8, 0.0]),
    "steps": STEPS + _waves((0.3, 9.0, 0.0)),
    "check": _waves((1.9, 0.37, 0.5), (0.4, 2.1, 0.0)),
}
"""Torque of each recording, N m; the last one is held out."""


def speeds(drive):
    """What the speed sensor of the `drive` shows in each recording, rad/s."""
    rng = np.random.default_rng(3)
    for name, u in INPUTS.items():
        v = np.asarray(simulate(drive, u, RATE, substeps=16).v) + OFFSET
        yield name, u, v + NOISE * rng.standard_normal(u.size)


def recordings_of_speed(drive):
    """The same as recordings."""
    return tuple(
        Recording(name, RATE, u, integral_of(v, RATE), v=v, integrated=True, role=_role(name))
        for name, u, v in speeds(drive)
    )


def _role(name):
    return "holdout" if name == "check" else "fit"
