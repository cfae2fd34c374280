"""scipy's LSODA on the equations in numpy, the step no longer than a sample so that no input change is passed over."""

import numpy as np
from scipy.integrate import solve_ivp


def simulate(parameters, force, dt, rtol):
    """Position (n,) of one drive from rest; absolute tolerance 1e-3 `rtol` in scaled units."""
    J, s0, s1, s2, Fc, Fs, vs = (float(p) for p in parameters)
    scale = np.array([Fs / s0, Fs / s0 * np.sqrt(s0 / J), Fs / s0])
    held = [float(f) for f in force]

    def field(t, y):
        v, z = y[1] * scale[1], y[2] * scale[2]
        rate = v - abs(v) * s0 * z / (Fc + (Fs - Fc) * np.exp(-((v / vs) ** 2)))
        push = held[min(int(t / dt), len(held) - 1)]
        return [v / scale[0], (push - s0 * z - s1 * rate - s2 * v) / J / scale[1], rate / scale[2]]

    t = np.arange(len(held)) * dt
    done = solve_ivp(
        field, (0.0, t[-1]), np.zeros(3), "LSODA", t_eval=t, max_step=dt, rtol=rtol, atol=1e-3 * rtol
    )
    return done.y[0] * scale[0]
