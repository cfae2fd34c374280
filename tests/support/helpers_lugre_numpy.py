"""LuGre written out again in numpy and solved by other roads, to judge `simulate` by: nothing is shared with it."""

import numpy as np
from scipy.integrate import solve_ivp


def numbers(drive):
    """J, sigma0, sigma1, sigma2, Fc, Fs, vs of a drive."""
    f = drive.friction
    return [float(p) for p in (drive.J, f.sigma0, f.sigma1, f.sigma2, f.Fc, f.Fs, f.vs)]


def by_radau(drive, force, rate, stiffness=0.0, rtol=1e-11, atol=1e-12):
    """Position, velocity and deflection at the samples, shape `(3, n)`, of a mass that a spring of `stiffness` holds.

    Radau with the exact Jacobian, started again at every sample: no jump of the input is stepped over.
    """
    J, s0, s1, s2, fc, fs, vs = numbers(drive)
    scale = fs / s0 * np.array([1.0, np.sqrt(s0 / J), 1.0])

    def field(_, scaled, held):
        x, v, z = scaled * scale
        slips = v - s0 * abs(v) * z / (fc + (fs - fc) * np.exp(-((v / vs) ** 2)))
        return np.array([v, (held - s0 * z - s1 * slips - s2 * v - stiffness * x) / J, slips]) / scale

    def jacobian(_, scaled, held):
        _, v, z = scaled * scale
        peak = (fs - fc) * np.exp(-((v / vs) ** 2))
        slip = s0 * abs(v) / (fc + peak)
        rate_v = 1.0 - s0 * z / (fc + peak) * np.sign(v) - slip * z * 2.0 * v / vs**2 * peak / (fc + peak)
        row = [-stiffness / J, -(s1 * rate_v + s2) / J, -(s0 - s1 * slip) / J]
        return np.array([[0.0, 1.0, 0.0], row, [0.0, rate_v, -slip]]) * scale / scale[:, None]

    states = [np.zeros(3)]
    for held in force[:-1]:
        solution = solve_ivp(
            field, (0.0, 1 / rate), states[-1], "Radau", args=(held,), jac=jacobian, rtol=rtol, atol=atol
        )
        assert solution.success
        states.append(solution.y[:, -1])
    return (np.array(states) * scale).T


def by_frozen_velocity(drive, force, rate, substeps):
    """Position by the usual shortcut: the bristle exactly, with the velocity frozen over the step."""
    J, s0, s1, s2, fc, fs, vs = numbers(drive)
    x, v, z, h, positions = 0.0, 0.0, 0.0, 1.0 / rate / substeps, []
    for held in force:
        positions.append(x)
        for _ in range(substeps):
            slip = s0 * abs(v) / (fc + (fs - fc) * np.exp(-((v / vs) ** 2)))
            growth = -np.expm1(-slip * h) / slip if slip > 0.0 else h
            z = z * np.exp(-slip * h) + v * growth
            v = v + h * (held - s0 * z - s1 * (v - slip * z) - s2 * v) / J
            x = x + h * v
    return np.array(positions)


def quasi_static(drive, force, rate, v0):
    """Velocity when the bristle is always bent as far as it bends: J v' = u - G(v) sgn v - sigma2 v."""
    J, _, _, s2, fc, fs, vs = numbers(drive)

    def field(_, v, held, way):
        return (held - way * (fc + (fs - fc) * np.exp(-((v / vs) ** 2))) - s2 * v) / J

    def stops(_, v, held, way):
        return v[0]

    stops.terminal = True
    v, way, velocity = v0, np.sign(v0), [v0]
    for held in force[:-1]:
        t = 0.0
        while t < 1 / rate:
            args = (held, way)
            part = solve_ivp(field, (t, 1 / rate), [v], args=args, events=stops, rtol=1e-10, atol=1e-13)
            t, v = part.t[-1], part.y[0, -1]
            if part.status == 1:  # the force carries it on, the other way
                way = -way
                v = 1e-12 * way
        velocity.append(v)
    return np.array(velocity)


def ros2_longdouble(parameters, force, rate, substeps=1):
    """The production scheme in 80 bits, for `parameters` of shape `(7, p)`: position at the samples, shape `(n, p)`,
    and how often the first set looked ahead across a reversal, and had a deflection cut.

    A deflection is cut where that of the first set is: there `simulate` takes the cut for a constant.
    """
    J, s0, s1, s2, fc, fs, vs = np.asarray(parameters, np.longdouble)
    one = np.longdouble(1)
    g, h = one - np.sqrt(one / 2), one / (np.longdouble(rate) * substeps)
    bound = np.longdouble(2.5) * fs[0] / s0[0]
    x, v, z = np.zeros((3, J.size), np.longdouble)
    positions, cuts, turned = [], 0, 0

    def level(v):
        return fc + (fs - fc) * np.exp(-((v / vs) ** 2))

    for held in np.asarray(force, np.longdouble):
        positions.append(x)
        for _ in range(substeps):
            now = level(v)
            bend = s0 * z / now
            rate_z = v - np.abs(v) * bend
            acceleration = (held - s0 * z - s1 * rate_z - s2 * v) / J
            ahead = v + h * acceleration
            turns = (ahead + v) * v < 0
            fast = np.where(turns, ahead, v)
            slip = np.abs(fast) / now
            slope = np.where(turns, 0, -2 * v / vs**2 * (now - fc))
            a_zv, a_zz = 1 - np.sign(fast) * bend + slip * bend * slope, -slip * s0
            a_vv, a_vz = -(s2 + s1 * a_zv) / J, -(s0 + s1 * a_zz) / J
            determinant = (1 - g * h * a_vv) * (1 - g * h * a_zz) - (g * h) ** 2 * a_vz * a_zv

            def solve(right_v, right_z, a=(a_vv, a_vz, a_zv, a_zz), determinant=determinant):
                a_vv, a_vz, a_zv, a_zz = a
                k_v = ((1 - g * h * a_zz) * right_v + g * h * a_vz * right_z) / determinant
                return k_v, ((1 - g * h * a_vv) * right_z + g * h * a_zv * right_v) / determinant

            k_v, k_z = solve(acceleration, rate_z)
            v1, z1 = v + h * k_v, z + h * k_z
            rate_1 = v1 - np.abs(v1) * s0 * z1 / level(v1)
            l_v, l_z = solve((held - s0 * z1 - s1 * rate_1 - s2 * v1) / J - 2 * k_v, rate_1 - 2 * k_z)
            # The position is in no equation but its own: k1 = v + g h k_v, k2 = v1 - 2 k1 + g h l_v.
            k_x = v + g * h * k_v
            x = x + h * (k_x + v1 + g * h * l_v) / 2
            v, z = v + h * (3 * k_v + l_v) / 2, z + h * (3 * k_z + l_z) / 2
            cut = np.clip(z, -bound, bound)
            v, z, cuts, turned = (
                v + s1 * (z - cut) / J,
                cut,
                cuts + int(z[0] != cut[0]),
                turned + int(turns[0]),
            )
    return np.array(positions), turned, cuts


def slopes_longdouble(parameters, force, rate, substeps=1, step=1e-6):
    """Derivatives of the position by the logarithms of the parameters, shape `(n, 7)`: fourth-order differences."""
    ways = [(index, k) for index in range(7) for k in (-2, -1, 1, 2)]
    sets = np.tile(np.asarray(parameters, np.longdouble)[:, None], 1 + len(ways))
    for column, (index, k) in enumerate(ways):
        sets[index, 1 + column] *= np.exp(np.longdouble(k) * np.longdouble(step))
    x, _, _ = ros2_longdouble(sets, force, rate, substeps)
    low2, low, high, high2 = np.moveaxis(x[:, 1:].reshape(-1, 7, 4), 2, 0)
    return (8 * (high - low) - (high2 - low2)) / (12 * np.longdouble(step))
