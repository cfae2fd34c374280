"""Three planned experiments on any plant: noise below break-away, a ramp through it, and sliding."""

import jax
import numpy as np

from frictionjax.excitation import prbs, ramp

N, RATE = 1000, 2000.0
PRESLIDING, BREAK_AWAY, SLIDING = range(3)


def plan(drive, *, level=0.2):
    """Inputs, start velocities and a noise of a thousandth of the deflection at break-away, for `drive`."""
    friction, k = drive.friction, float(drive.motor_constant)
    Fs, Fc, v0 = float(friction.Fs), float(friction.Fc), 20.0 * float(friction.vs)
    t = np.arange(N) / RATE
    inputs = [
        np.asarray(prbs(jax.random.key(0), N, RATE, 500.0, level * Fs / k)),
        np.asarray(ramp(N, RATE, 1.5 * Fs / k)),
        (Fc + float(friction.sigma2) * v0 + 0.3 * Fc * np.sin(2.0 * np.pi * 7.0 * t)) / k,
    ]
    return inputs, [0.0, 0.0, v0], 1e-3 * Fs / float(friction.sigma0)
