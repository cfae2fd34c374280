"""The best that anyone could predict: the machine's own model, watching what was measured."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .kernel import clocks, measured, place_of, shown_late, through_sample
from .laws import core_level, level_of, place_level, sliding_deflection, yielding


@njit(cache=True)
def watch(knobs, state, y, worth, rested, gains, start, dt, substeps, kept, every):
    """Run the machine's own model along a recording `y` of it, corrected by the measurement at every sample, without
    knowing what was random; every `every`-th corrected state goes into `kept`. The drive's output is `worth`, and was
    `rested` before.

    The correction is the one of a fixed-gain observer (`gains` of position and velocity): the machine is moved as a
    whole, and each bristle with it as far as it does not slip.
    """
    p = knobs[0]
    s = state[0]
    n = y.size
    seen, speed = np.zeros(n), np.zeros(n)
    h = dt / substeps
    whole = int(p.delay / dt)
    switch = (p.delay / dt - whole) * substeps
    late = int(p.out_delay / dt)
    part = p.out_delay / dt - late
    s.core = core_level(p, s, s.v)
    for k in range(n):
        clocks(p, s, start + k * dt)
        seen[k] = place_of(p, s)
        speed[k] = s.v
        s.seen = shown_late(seen, speed, k, late, part, dt)
        off = y[k] - measured(p, s)
        moved = gains[0] * off
        s.x, s.x2, s.ys, s.play = s.x + moved, s.x2 + moved, s.ys + moved, s.play + moved
        s.ys2 += moved
        seen[k] += moved
        s.v += gains[1] * off
        speed[k] = s.v
        s.v2 += gains[1] * off
        place_level(p, s, s.x)
        s.core = core_level(p, s, s.v)
        g = level_of(p, s, s.v, s.core)
        z_ss = sliding_deflection(p, g)
        s.z += moved * max(0.0, 1.0 - yielding(p, s.z, s.v, z_ss) * abs(s.z) / z_ss)
        for i in range(int(p.mw_n)):
            s.mw[i] += p.mw_k[i] * moved * max(0.0, 1.0 - abs(s.mw[i]) / (p.mw_a[i] * g))
        if k % every == 0:
            kept[k // every] = state[0]
        new = worth[k - whole] if k >= whole else rested
        old = worth[k - whole - 1] if k >= whole + 1 else rested
        through_sample(p, s, old, new, switch, 0.0, h, substeps)


@njit(cache=True)
def ahead(knobs, kept, every, worth, rested, horizon, last, start, dt, substeps):
    """What the sensor will show `horizon` samples (and up to `last` - 1 more) after each kept state, if nothing random
    happens meanwhile; NaN at the samples that no run reaches."""
    p = knobs[0]
    n = worth.size
    shown = np.full(n, np.nan)
    h = dt / substeps
    whole = int(p.delay / dt)
    switch = (p.delay / dt - whole) * substeps
    late = int(p.out_delay / dt)
    part = p.out_delay / dt - late
    ou_e = math.exp(-dt / p.ou_tau)
    for i in range(kept.size):
        begin = i * every
        if begin + horizon + last > n:
            break
        state = kept[i : i + 1].copy()
        s = state[0]
        seen, speed = np.zeros(horizon + last), np.zeros(horizon + last)
        for j in range(horizon + last):
            k = begin + j
            if j > 0:
                s.ou *= ou_e
            clocks(p, s, start + k * dt)
            seen[j] = place_of(p, s)
            speed[j] = s.v
            s.seen = shown_late(seen, speed, j, late, part, dt)
            if j >= horizon:
                shown[k] = measured(p, s)
            new = worth[k - whole] if k >= whole else rested
            old = worth[k - whole - 1] if k >= whole + 1 else rested
            through_sample(p, s, old, new, switch, 0.0, h, substeps)
    return shown
