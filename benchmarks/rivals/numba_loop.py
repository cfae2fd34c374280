"""The same scheme as a numba loop over scalar simulations: what a careful user would write."""

import numba
import numpy as np


@numba.njit(fastmath=True, error_model="numpy")
def simulate(parameters, force, dt, substeps, out):
    """Positions of one drive from rest into `out` (n,); `parameters` J, sigma0, sigma1, sigma2, Fc, Fs, vs."""
    J, s0, s1, s2, Fc, Fs, vs = parameters
    mobility, drop, per_vs, bound = 1.0 / J, Fs - Fc, 1.0 / vs, 2.5 * Fs / s0
    h = dt / substeps
    gh = (1.0 - 0.5**0.5) * h
    x = v = z = 0.0
    for k in range(force.size):
        out[k] = x
        for _ in range(substeps):
            r = v * per_vs
            bell = drop * np.exp(-r * r)
            soft = 1.0 / (Fc + bell)
            spring = s0 * z
            bend = spring * soft
            rate = v - abs(v) * bend
            friction = spring + s1 * rate + s2 * v
            a = (force[k] - friction) * mobility
            ahead = v + h * a
            turns = (ahead + v) * v < 0.0
            fast = ahead if turns else v
            slip = abs(fast) * soft
            rate_z = -slip * s0
            side = bend if fast > 0.0 else (-bend if fast < 0.0 else 0.0)
            rate_v = 1.0 - side
            if not turns:
                rate_v -= slip * bend * 2.0 * r * per_vs * bell
            below_z = 1.0 - gh * rate_z
            coupling = -gh * mobility * (s0 + s1 * rate_z)
            below_v = 1.0 + gh * (s2 + s1 * rate_v) * mobility
            pivot_z = 1.0 / below_z
            pivot_v = below_z / (below_z * below_v - gh * coupling * rate_v)
            arm = coupling * pivot_z
            k1v = (a + arm * rate) * pivot_v
            k1z = (rate + gh * rate_v * k1v) * pivot_z
            k1x = v + gh * k1v
            v1, z1 = v + h * k1v, z + h * k1z
            r1 = v1 * per_vs
            rate1 = v1 - abs(v1) * s0 * z1 / (Fc + drop * np.exp(-r1 * r1))
            friction1 = s0 * z1 + s1 * rate1 + s2 * v1
            a1 = (force[k] - friction1) * mobility - 2.0 * k1v
            b1 = rate1 - 2.0 * k1z
            k2v = (a1 + arm * b1) * pivot_v
            k2z = (b1 + gh * rate_v * k2v) * pivot_z
            k2x = v1 - 2.0 * k1x + gh * k2v
            z2 = z + h * (1.5 * k1z + 0.5 * k2z)
            within = min(max(z2, -bound), bound)
            x += h * (1.5 * k1x + 0.5 * k2x)
            v += h * (1.5 * k1v + 0.5 * k2v) + s1 * (z2 - within) * mobility
            z = within


@numba.njit(parallel=True, fastmath=True, error_model="numpy")
def simulate_all(parameters, force, dt, substeps, out):
    """Positions of all drives into `out` (b, n), one core taking one drive after the other; `parameters` (b, 7)."""
    for drive in numba.prange(parameters.shape[0]):
        simulate(parameters[drive], force, dt, substeps, out[drive])


@numba.njit(parallel=True, fastmath=True, error_model="numpy")
def simulate_last(parameters, force, dt, substeps, out):
    """The last position of all drives into `out` (b,); `parameters` (b, 7)."""
    for drive in numba.prange(parameters.shape[0]):
        every = np.empty(force.size)
        simulate(parameters[drive], force, dt, substeps, every)
        out[drive] = every[-1]


@numba.njit(fastmath=True, error_model="numpy")
def jacobian(parameters, force, dt, substeps, step, out):
    """Positions (row 0 of `out`) and their derivatives by the logarithm of each parameter, by differences of relative
    `step`; `out` (8, n)."""
    simulate(parameters, force, dt, substeps, out[0])
    for i in range(parameters.size):
        moved = parameters.copy()
        moved[i] *= 1.0 + step
        simulate(moved, force, dt, substeps, out[i + 1])
        for k in range(force.size):
            out[i + 1, k] = (out[i + 1, k] - out[0, k]) / step
