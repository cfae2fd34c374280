"""An arm under gravity, and recordings of its swings."""

import numpy as np
from helpers_plants import effect

from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate

RATE, SINE, NOISE = 200.0, 11.0, 2e-5
GRAVITY = effect("GravityPendulum", sine=SINE)
ARM = Drive(0.35, LuGre(sigma0=900.0, sigma1=6.0, sigma2=0.08, Fc=0.65, Fs=0.8, vs=0.05), effects=(GRAVITY,))
"""An arm whose gravity is seventeen times its friction."""


def swings(drive=ARM, seconds=8.0):
    """Four recordings of the arm on its way to and fro, the last one held out."""
    rng, found = np.random.default_rng(7), []
    t = np.arange(round(seconds * RATE)) / RATE
    for number in range(4):
        slow, fast = 2.0 * np.pi * (0.21 + 0.05 * number), 2.0 * np.pi * 0.83
        x = 0.8 * np.sin(slow * t + number) + 0.4 * np.sin(fast * t + 2.0 * number)
        v = 0.8 * slow * np.cos(slow * t + number) + 0.4 * fast * np.cos(fast * t + 2.0 * number)
        a = np.gradient(v, t)
        u = SINE * np.sin(x) + 0.35 * a + 0.65 * np.tanh(v / 0.02)
        moved = np.asarray(simulate(drive, u, RATE, substeps=20).x) + NOISE * rng.standard_normal(t.size)
        role = "holdout" if number == 3 else "fit"
        found.append(Recording(f"swing_{number}", RATE, u, moved, role=role))
    return tuple(found)
