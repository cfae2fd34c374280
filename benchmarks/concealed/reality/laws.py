"""Constitutive laws of the simulated machine: friction level, bristle, parallel forces, coupling. Compiled."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def core_level(p, s, v):
    """Sliding level from speed and contact age, before place, direction and load act on it."""
    w = s.lag if p.lag_tau > 0.0 else v
    r = abs(w) / p.vs
    if p.st_exp == 2.0:  # noqa: SIM108 (the nested form is no easier to read)
        shape = math.exp(-r * r) if r < 7.0 else 0.0
    else:
        shape = math.exp(-(r**p.st_exp))
    if p.st_lorentz != 0.0:
        shape += p.st_lorentz * (1.0 / (1.0 + r * r) - shape)
    if p.st_hyper != 0.0:
        shape += p.st_hyper * (1.0 / (1.0 + r) - shape)
    level = p.fc + (p.fs * s.fs_mult - p.fc) * shape
    if p.dwell_b != 0.0:
        if p.dwell_kind == 0.0:
            level += p.dwell_b * math.log1p(s.age / p.dwell_t)
        elif p.dwell_kind == 2.0:
            level += p.dwell_b * ((1.0 + s.age / p.dwell_t) ** p.dwell_pow - 1.0)
        else:
            level += p.dwell_b * (1.0 - math.exp(-s.age / p.dwell_t))
    return level


@njit(cache=True)
def level_of(p, s, v, core):
    """Friction level G: the bristle force of steady sliding at velocity v."""
    side = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
    if p.dir_fc != 0.0:
        core += p.dir_fc * side * p.fc
    return s.mult * (1.0 + p.dir_c * side) * core + s.load


@njit(cache=True)
def elastic(p, z):
    """Bristle force at deflection z, and the deflection a linear bristle would need for it."""
    if p.nl_hard != 0.0:
        r = z / p.z0
        z = z * (1.0 + p.nl_hard * r * r)
    elif p.nl_soft != 0.0:
        a = math.sqrt(1.5 * p.nl_soft)
        z = math.atan(a * z / p.z0) * p.z0 / a
    elif p.nl_rise != 0.0:
        z += math.copysign(p.nl_rise * max(abs(z) - p.nl_knee * p.z0, 0.0), z)
    return p.s0 * z, z


@njit(cache=True)
def sliding_deflection(p, g):
    """Deflection at which the bristle carries exactly the level g: sliding friction keeps its law."""
    if p.nl_hard != 0.0:
        target = g / (p.s0 * p.z0)
        r = target / (1.0 + 0.7 * p.nl_hard * target * target)
        for _ in range(5):
            r -= (r * (1.0 + p.nl_hard * r * r) - target) / (1.0 + 3.0 * p.nl_hard * r * r)
        return r * p.z0
    if p.nl_soft != 0.0:
        a = math.sqrt(1.5 * p.nl_soft)
        # An arctangent carries no more than pi/2: what is asked beyond would never be reached.
        return math.tan(min(a * g / (p.s0 * p.z0), 1.45)) * p.z0 / a
    if p.nl_rise != 0.0:
        knee = p.nl_knee * p.z0
        return min(g / p.s0, (g / p.s0 + p.nl_rise * knee) / (1.0 + p.nl_rise))
    return g / p.s0


@njit(cache=True)
def yielding(p, z, v, z_ss):
    """How much of the motion is slip: 1 for LuGre, none below break-away for an elasto-plastic bristle."""
    if p.ep_ratio == 0.0:
        return 1.0
    if v * z <= 0.0:
        return 0.0
    r = (abs(z) / z_ss - p.ep_ratio) / (1.0 - p.ep_ratio)
    if r <= 0.0:
        return 0.0
    if p.ep_pow > 0.0:
        return min(r, 1.0) ** p.ep_pow
    return 1.0 if r >= 1.0 else r * r * (3.0 - 2.0 * r)


@njit(cache=True)
def creep_rate(p, s):
    """Velocity of the contact's compartments in series with the bristle, loaded by its elastic force."""
    rate1 = rate2 = rate3 = 0.0
    if p.c1 != 0.0 or p.cl != 0.0:
        _, load = elastic(p, s.z)
        if p.c1 != 0.0:
            rate1 = (p.c1 * load - s.xc1) / p.t1
            if p.c2 != 0.0:
                rate2 = (p.c2 * load - s.xc2) / p.t2
        if p.cl != 0.0:
            # Eyring's dashpot: the rate is exponential in what the spring beside it leaves, hence a logarithm in time.
            drive = min(max((p.cl * load - s.xcl) / p.cl_len, -14.0), 14.0)
            rate3 = p.cl_len / p.cl_tau * math.sinh(drive)
    return rate1, rate2, rate3


@njit(cache=True)
def friction(p, s, v, g):
    """Friction force at velocity v with all deflections held."""
    viscous = p.s2 * s.visc * v * (1.0 + (p.dir_v if v > 0.0 else -p.dir_v))
    damping = p.s1
    if p.micro_v > 0.0:
        r2 = (v / p.micro_v) ** 2
        left = 1.0 / (1.0 + r2) if p.micro_tail == 1.0 else math.exp(-r2)
        damping *= 1.0 - p.micro_w * (1.0 - left)
    total = viscous
    own = 1.0 - p.mw_share
    if own > 0.0:
        r1, r2, r3 = creep_rate(p, s)
        v_in = v - (r1 + r2 + r3)
        z_ss = sliding_deflection(p, g)
        z_dot = v_in - yielding(p, s.z, v_in, z_ss) * abs(v_in) * s.z / z_ss
        spring, _ = elastic(p, s.z)
        total += own * (spring + damping * z_dot + s.ve[0] + s.ve[1] + s.ve[2])
    if p.mw_share > 0.0:
        held = 0.0
        for i in range(int(p.mw_n)):
            # From what the element would carry without bound, so that one that slips follows the level at once.
            bound = p.mw_a[i] * g
            held += min(max(s.mw_free[i], -bound), bound)
        # Elements that slip do not stretch: damping fades as the loaded share of them grows.
        total += held + damping * (p.mw_share * v - abs(v) * held / g)
    return total


@njit(cache=True)
def speed_force(p, v):
    """Parallel forces that depend on velocity alone."""
    force = 0.0
    if p.quad != 0.0:
        if p.quad_pow == 2.0:
            force += p.quad * v * abs(v)
        else:
            force += math.copysign(p.quad * abs(v) ** p.quad_pow, v)
    if p.pow4 != 0.0:
        force += p.pow4 * v * abs(v) * v * v
    if p.pinch_a != 0.0:
        r = (abs(v) - p.pinch_v) / p.pinch_w
        if abs(r) < 6.0:
            force += math.copysign(p.pinch_a * math.exp(-r * r), v)
    return force


@njit(cache=True)
def coupling(p, s, v, v2):
    """Force the first inertia spends on the second."""
    stretch = s.x - s.x2
    if p.gap == 0.0:
        if p.k2_hard != 0.0:
            stretch *= 1.0 + p.k2_hard * (stretch / p.k2_len) ** 2
        return p.k2 * stretch + p.d2 * (v - v2)
    if p.gap_k != 0.0:
        # Rubber fills the gap: soft inside, the flank on top of it outside.
        soft = p.gap_k * min(max(stretch, -p.gap), p.gap)
        over = stretch - min(max(stretch, -p.gap), p.gap)
        return soft + p.k2 * over + p.d2 * (v - v2) * (1.0 if over != 0.0 else math.sqrt(p.gap_k / p.k2))
    if abs(stretch) <= p.gap:
        return 0.0
    push = 1.0 if stretch > 0.0 else -1.0
    force = p.k2 * (stretch - push * p.gap) + p.d2 * (v - v2)
    # A gap's flanks push and never pull.
    return force if force * push > 0.0 else 0.0


@njit(cache=True)
def slow_level(p, s):
    """What clock, heat and chance make of friction: once per sample."""
    warm = 1.0 - math.exp(-s.clock / p.warm_tau)
    heat = 1.0 - math.exp(-s.heat)
    level = 1.0 - p.warm_c * warm - p.heat_c * heat
    if p.warm_c2 != 0.0:
        level -= p.warm_c2 * (1.0 - math.exp(-s.clock / p.warm_tau2))
    s.slow = level * math.exp(s.ou)
    s.visc = 1.0 - p.warm_v * warm - p.heat_v * heat


@njit(cache=True)
def place_level(p, s, x):
    """What the place makes of friction."""
    mult = 1.0
    if p.pos_a != 0.0:
        mult += p.pos_a * math.sin(2.0 * math.pi * x / p.pos_p + p.pos_ph)
    if p.pos_lin != 0.0 or p.pos_quad != 0.0:
        r = min(max(x / p.pos_len, -1.5), 1.5)
        mult += p.pos_lin * r + p.pos_quad * r * r
    if p.pos_saw != 0.0:
        # A saw whose tooth rises over nine tenths of its pitch and falls over the last one.
        part = x / p.pos_p - math.floor(x / p.pos_p)
        mult += p.pos_saw * (2.0 * min(part / 0.9, (1.0 - part) / 0.1) - 1.0)
    if p.pos_hill != 0.0:
        mult += p.pos_hill * math.exp(-(((x - p.pos_x) / p.pos_w) ** 2))
    if p.bump_a != 0.0:
        mult += p.bump_a * math.exp(-(((x - p.bump_x) / p.bump_w) ** 2))
    if p.nth_a != 0.0 and math.floor(x / p.nth_p) % p.nth_n == 1.0:
        mult += p.nth_a * math.sin(math.pi * (x / p.nth_p - math.floor(x / p.nth_p))) ** 2
    if p.spot_a != 0.0:
        s.fs_mult = 1.0 + p.spot_a * math.exp(-(((x - p.spot_x) / p.spot_w) ** 4))
    s.mult = mult * s.slow


@njit(cache=True)
def place_force(p, s):
    """Parallel forces that depend on position and clock."""
    x = s.x
    force = p.const + p.spring * x + s.pulse
    if p.grav != 0.0:
        force += p.grav * math.sin(x + p.grav_x0)
        if p.grav2 != 0.0:
            force += p.grav2 * math.sin(2.0 * (x + p.grav_x0))
    if p.const_bend != 0.0:
        force += p.const_bend * math.tanh(x / p.const_len)
    if p.spring3 != 0.0:
        force += p.spring3 * x * x * x
    if p.rip_peak != 0.0:
        # Slots of a motor: short pulls to either side, level between them.
        turn = 2.0 * math.pi * x / p.rip_p + p.rip_f1
        force += p.rip_peak * math.sin(turn) * math.exp(3.0 * (math.cos(turn) - 1.0))
    if p.rip1 != 0.0:
        turn = 2.0 * math.pi * x / p.rip_p
        force += p.rip1 * math.sin(turn + p.rip_f1) + p.rip2 * math.sin(2.0 * turn + p.rip_f2)
    if p.slack_k != 0.0 and x > p.slack_x:
        force += p.slack_k * (x - p.slack_x)
    if p.detent_a != 0.0:
        fade = math.exp(-s.clock / p.detent_tau)
        force += p.detent_a * fade * math.sin(2.0 * math.pi * x / p.detent_p + p.detent_ph)
    if p.vib_a != 0.0:
        force += p.vib_a * math.sin(2.0 * math.pi * p.vib_f * s.clock + p.vib_ph)
    return force
