"""The simulator: one compiled loop over samples and substeps, with the controller inside.

A substep is drift - kick - drift (Strang splitting, second order): positions and deflections move for half a substep
at constant velocity, where a bristle has an exact exponential solution and a Maxwell element is an exact clipped play;
then the velocity takes the whole substep's forces at fixed positions; then positions move for the other half.
Velocity is never smoothed, so nothing leaks at rest.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .laws import (
    core_level,
    coupling,
    creep_rate,
    friction,
    level_of,
    place_force,
    place_level,
    sliding_deflection,
    slow_level,
    speed_force,
    yielding,
)

# Open loop with a trip, or closed loop; the fields of the loop's array.
KP, KD, TAU_D, U_MAX, TRIP, KI = range(6)
# What the loop carries on from one run to the next: filtered slope and last value of the error, its integral, and what
# the input was worth last.
SLOPE, BEFORE, INTEGRAL, WORTH = range(4)


@njit(cache=True)
def _decay(a):
    """exp(-a) and (1 - exp(-a)) / a, exact to rounding for small a as well."""
    if a < 1e-3:
        return 1.0 - a * (1.0 - a * (0.5 - a / 6.0)), 1.0 - a * (0.5 - a * (1.0 / 6.0 - a / 24.0))
    e = math.exp(-a)
    return e, (1.0 - e) / a


@njit(cache=True)
def _lag_time(p, s, v):
    """Time with which the friction level follows; another one while the speed rises."""
    return p.lag_tau * p.lag_rise if abs(v) > abs(s.lag) else p.lag_tau


@njit(cache=True)
def _drift(p, s, h):
    """Positions, deflections and hidden states over time h at constant velocity."""
    v = s.v
    # Level and lag at the middle of the stretch, for second order.
    place_level(p, s, s.x + 0.5 * v * h)
    s.x += v * h
    if p.lag_tau > 0.0:
        e, _ = _decay(0.5 * h / _lag_time(p, s, v))
        s.lag = v + (s.lag - v) * e
    if p.lag_tau > 0.0 or p.dwell_b != 0.0 or p.spot_a != 0.0:
        s.core = core_level(p, s, v)
    g = level_of(p, s, v, s.core)
    slip = 0.0
    if p.mw_share < 1.0:
        r1, r2, r3 = creep_rate(p, s)
        v_in = v - (r1 + r2 + r3)
        s.xc1 += r1 * h
        s.xc2 += r2 * h
        s.xcl += r3 * h
        z_ss = sliding_deflection(p, g)
        z = s.z
        share = 1.0
        if p.ep_ratio > 0.0:
            # Two passes: the share of slip that holds half-way is the one to use for the whole stretch.
            share = yielding(p, z, v_in, z_ss)
            a = 0.5 * h * share * abs(v_in) / z_ss
            e, q = _decay(a)
            share = yielding(p, z * e + 0.5 * h * q * v_in, v_in, z_ss)
        e, q = _decay(h * share * abs(v_in) / z_ss)
        s.z = z * e + h * q * v_in
        slip = abs(v) * abs(s.z) / z_ss
        if p.ve_k[0] != 0.0:
            for j in range(3):
                e, q = _decay(h / p.ve_tau[j])
                s.ve[j] = s.ve[j] * e + p.ve_k[j] * (s.z - z) * q
    if p.mw_share > 0.0:
        held = 0.0
        for i in range(int(p.mw_n)):
            bound = p.mw_a[i] * g
            s.mw_free[i] = s.mw[i] + p.mw_k[i] * v * h
            s.mw[i] = min(max(s.mw_free[i], -bound), bound)
            held += abs(s.mw[i])
        slip = max(slip, abs(v) * held / (p.mw_share * g))
    if p.m2 > 0.0:
        s.x2 += s.v2 * h
    if p.lag_tau > 0.0:
        e, _ = _decay(0.5 * h / _lag_time(p, s, v))
        s.lag = v + (s.lag - v) * e
    if p.dwell_b != 0.0:
        e, q = _decay(h * slip / p.dwell_d)
        s.age = s.age * e + h * q
    if p.sensor_tau > 0.0:
        e, q = _decay(h / p.sensor_tau)
        s.ys += (s.x - 0.5 * v * h - s.ys) * (1.0 - e)
        if p.sensor_twice == 1.0:
            s.ys2 += (s.ys - s.ys2) * (1.0 - e)
    if p.play_b > 0.0:
        s.play = min(max(s.play, s.x - p.play_b), s.x + p.play_b)


@njit(cache=True)
def _kick(p, s, motor, disturbance, h):
    """Velocities over time h at fixed positions, by the midpoint rule."""
    v, v2 = s.v, s.v2
    m1 = s.inertia - p.m2
    place_level(p, s, s.x)
    if p.lag_tau > 0.0 or p.dwell_b != 0.0 or p.spot_a != 0.0:
        s.core = core_level(p, s, v)
    push = motor - place_force(p, s) + disturbance
    link = coupling(p, s, v, v2) if p.m2 > 0.0 else 0.0
    fric = friction(p, s, v, level_of(p, s, v, s.core))
    vm = v + 0.5 * h * (push - fric - speed_force(p, v) - link) / m1
    if p.m2 > 0.0:
        v2m = v2 + 0.5 * h * (link - p.b2 * v2) / p.m2
        link = coupling(p, s, vm, v2m)
        s.v2 = v2 + h * (link - p.b2 * v2m) / p.m2
    fric = friction(p, s, vm, level_of(p, s, vm, core_level(p, s, vm)))
    s.v = v + h * (push - fric - speed_force(p, vm) - link) / m1
    s.core = core_level(p, s, s.v)
    s.force = fric
    if p.heat_c != 0.0 or p.heat_v != 0.0:
        s.heat += h * (abs(fric * vm) / p.heat_ref - s.heat) / p.heat_tau


@njit(cache=True)
def shown_late(seen, speed, k, late, part, dt):
    """What the sensor reads at sample `k` when it is `late` samples and a `part` of one behind, from what it read at
    the samples, `seen`, and its `speed` there: a cubic, exact while the acceleration within a sample is constant. (A
    straight line would leave up to an eighth of a dt^2, which no delay does.)"""
    if k - late - 1 < 0:
        return seen[max(k - late, 0)]  # before the first sample the machine has rested where it is
    a, b = seen[k - late - 1], seen[k - late]
    f = 1.0 - part
    bend = (1.0 - f) * (speed[k - late - 1] * dt - (b - a)) + f * ((b - a) - speed[k - late] * dt)
    return a + f * (b - a) + f * (1.0 - f) * bend


@njit(cache=True)
def place_of(p, s):
    """The position that the sensor follows: behind its filter, or behind its play."""
    if p.sensor_tau > 0.0:
        return s.ys2 if p.sensor_twice == 1.0 else s.ys
    return s.play if p.play_b > 0.0 else s.x


@njit(cache=True)
def measured(p, s):
    """What the sensor makes of the position, before noise and rounding."""
    y = s.seen
    if p.enc1 != 0.0 or p.enc2 != 0.0:
        turn = 2.0 * math.pi * y / p.enc_p
        y += p.enc1 * math.sin(turn + p.enc_f1) + p.enc2 * math.sin(2.0 * turn + p.enc_f2)
    if p.enc_bent != 0.0:
        # Straight between its turning points: what a wrong interpolation table leaves.
        y += p.enc_bent * (2.0 / math.pi) * math.asin(math.sin(2.0 * math.pi * y / p.enc_p + p.enc_f1))
    if p.mains3 != 0.0:
        y += p.mains3 * math.sin(6.0 * math.pi * p.mains_f * s.clock + 3.0 * p.mains_ph)
    if p.mains_a != 0.0:
        y += p.mains_a * math.sin(2.0 * math.pi * p.mains_f * s.clock + p.mains_ph)
    return y + s.bias


@njit(cache=True)
def _drive(p, s, u, dt):
    """Static and slow parts of the drive: what the input is worth, in input units."""
    w = u
    if p.dead > 0.0:
        w = math.copysign(max(abs(w) - p.dead, 0.0), w)
    if p.dead_soft > 0.0:
        w -= p.dead_soft * math.tanh(w / p.dead_soft)
    if p.hys_a != 0.0:
        n = int(p.hys_n)
        held = 0.0
        for i in range(n):
            s.hys[i] = min(max(s.hys[i], w - p.hys_r[i]), w + p.hys_r[i])
            held += s.hys[i] / n
        w += p.hys_a * (held - w)
    if p.sat_u > 0.0 and p.sat_side * w >= 0.0:
        if p.sat_hard == 1.0:
            w = min(max(w, -p.sat_u), p.sat_u)
        else:
            w = w / (1.0 + (abs(w) / p.sat_u) ** p.sat_n) ** (1.0 / p.sat_n)
    if p.sag_a != 0.0:
        s.sag += (abs(u) / p.sag_u - s.sag) * (1.0 - math.exp(-dt / p.sag_tau))
        w *= 1.0 - p.sag_a * min(s.sag, 2.0)
    if p.fade_a != 0.0:
        w *= 1.0 - p.fade_a * (1.0 - math.exp(-s.clock / p.fade_tau))
    return w


@njit(cache=True)
def worth_of(knobs, state, u, start, dt):
    """What a drive makes of an input that is known, one value a sample, in input units."""
    worth = np.zeros(u.size)
    for k in range(u.size):
        state[0].clock = start + k * dt
        worth[k] = _drive(knobs[0], state[0], u[k], dt)
    return worth


@njit(cache=True)
def clocks(p, s, clock):
    """What time alone changes, at the beginning of a sample."""
    s.clock = clock
    s.inertia = p.J * (1.0 + p.pay_share) if p.pay_share != 0.0 and clock > p.pay_t else p.J
    slow_level(p, s)


@njit(cache=True)
def through_sample(p, s, old, new, switch, disturbance, h, substeps):
    """The substeps of one sample: the drive's output goes from `old` to `new` at the substep `switch`."""
    lag_e, _ = _decay(h / p.drive_tau if p.drive_tau > 0.0 else 0.0)
    for j in range(substeps):
        mix = min(max(j + 1.0 - switch, 0.0), 1.0)
        current = old + (new - old) * mix
        if p.drive_tau > 0.0:
            was = s.amp
            s.amp = current + (was - current) * lag_e
            current = 0.5 * (was + s.amp)
            if p.drive_twice == 1.0:
                was = s.amp2
                s.amp2 = current + (was - current) * lag_e
                current = 0.5 * (was + s.amp2)
        motor = p.km * current
        s.load = p.load_mu * abs(motor)
        if p.load_side != 0.0:
            s.load *= 1.0 + p.load_side * math.tanh(motor * s.v / (p.fc * p.vs))
        _drift(p, s, 0.5 * h)
        if p.tr1 != 0.0:
            turn = 2.0 * math.pi * s.x / p.tr_p
            motor *= 1.0 + p.tr1 * math.sin(turn + p.tr_f1) + p.tr2 * math.sin(2.0 * turn + p.tr_f2)
        if p.tr_flat != 0.0:
            motor *= 1.0 - p.tr_flat * abs(math.sin(math.pi * s.x / p.tr_p + 0.5 * p.tr_f1))
        if p.hit_a != 0.0:
            s.pulse *= 1.0 - h / p.hit_tau
            if (math.floor(s.x / p.hit_p + 0.5) - s.cell) * p.hit_dir > 0.0:
                s.pulse = p.hit_a * p.hit_dir
            s.cell = math.floor(s.x / p.hit_p + 0.5)
        _kick(p, s, motor, disturbance, h)
        _drift(p, s, 0.5 * h)


@njit(cache=True)
def simulate(
    knobs, state, closed, command, feed, gains, memory, step, noise, disturbance, slow, start, dt, substeps
):
    """Simulate one recording; returns input, measured position, what the sensor shows without noise and rounding, and
    the drive's output, and leaves `state` at its end.

    `command` is the input (open loop) or the reference (closed loop), held between samples; `feed` is what a closed
    loop adds to its input, and `memory` what it carries on, left as it is at the end; `noise` is added to the
    position before it is rounded to `step`; `disturbance` is a force held for one sample; `slow` drives random walks.
    In open loop the input goes to zero once the machine has run further than the trip distance, as an operator would
    let go, and comes back after its command has passed zero.
    """
    p = knobs[0]
    s = state[0]
    n = command.size
    u_out, y_out, clean = np.zeros(n), np.zeros(n), np.zeros(n)
    worth, seen, speed = np.zeros(n), np.zeros(n), np.zeros(n)
    h = dt / substeps
    whole = int(p.delay / dt)
    switch = (p.delay / dt - whole) * substeps
    slope, before, integral, rested = memory[SLOPE], memory[BEFORE], memory[INTEGRAL], memory[WORTH]
    tripped, origin = False, s.x
    ou_e = math.exp(-dt / p.ou_tau)
    late = int(p.out_delay / dt)
    part = p.out_delay / dt - late
    s.core = core_level(p, s, s.v)
    s.cell = math.floor(s.x / p.hit_p + 0.5)
    for k in range(n):
        if p.walk_std > 0.0:
            s.bias += p.walk_std * math.sqrt(dt) * slow[k, 0]
        if p.ou_std > 0.0:
            s.ou = s.ou * ou_e + p.ou_std * math.sqrt(1.0 - ou_e * ou_e) * slow[k, 1]
        clocks(p, s, start + k * dt)
        seen[k] = place_of(p, s)
        speed[k] = s.v
        s.seen = shown_late(seen, speed, k, late, part, dt)
        clean[k] = measured(p, s)
        y = step * np.round((clean[k] + noise[k]) / step)
        y_out[k] = y
        if closed:
            error = command[k] - y
            if k > 0 or memory[WORTH] != 0.0:
                slope += ((error - before) / dt - slope) * (dt / (gains[TAU_D] + dt))
            before = error
            wanted = gains[KP] * error + gains[KD] * slope + gains[KI] * integral + feed[k]
            u = min(max(wanted, -gains[U_MAX]), gains[U_MAX])
            if u == wanted:  # the integral waits while the drive gives all it has
                integral += error * dt
        else:
            u = command[k]
            if tripped and (u == 0.0 or u * command[k - 1] < 0.0):
                tripped, origin = False, y
            if abs(y - origin) > gains[TRIP]:
                tripped = True
            if tripped:
                u = 0.0
        u_out[k] = u
        worth[k] = _drive(p, s, u, dt)
        if p.jitter > 0.0:
            late_now = max(p.delay / dt + p.jitter * min(max(slow[k, 1], -2.0), 2.0), 0.0)
            whole = int(late_now)
            switch = (late_now - whole) * substeps
        new = worth[k - whole] if k >= whole else rested
        old = worth[k - whole - 1] if k >= whole + 1 else rested
        through_sample(p, s, old, new, switch, disturbance[k], h, substeps)
    memory[SLOPE], memory[BEFORE], memory[INTEGRAL], memory[WORTH] = slope, before, integral, worth[n - 1]
    return u_out, y_out, clean, worth
