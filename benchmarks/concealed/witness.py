"""What the simulator itself knows of a case: the best possible prediction, and where the effect's energy is.

The case is simulated again from its sealed seed. The oracle predicts 0.1 s ahead with the true structure and the true
parameters, in place of a refit of the true model, from states that an observer of 50 Hz has corrected by the
measurement: as the predictions that it is set beside. What was random it does not know. Where the recordings do not
hold a parameter, no refit could do as well: the recovered share of the error is then too small.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.concealed.make import HORIZON, simulated

REGIMES = (
    "stick (bristle bent below 20 % of break-away)",
    "presliding (20 to 80 %)",
    "break-away (above 80 %)",
    "slow sliding (Stribeck)",
    "sliding",
)
"""The regimes of the verdict's map, in its words."""


@njit(cache=True)
def _friction(v, dt, base):
    """LuGre's force and deflection along an imposed velocity, shape `(n,)` each, at the middle of each interval; `base`
    is sigma0, sigma1, sigma2, Fc, Fs, vs."""
    s0, s1, s2, fc, fs, vs = base
    force, bend, z = np.zeros(v.size), np.zeros(v.size), 0.0
    for k in range(v.size):
        g = (fc + (fs - fc) * math.exp(-((v[k] / vs) ** 2))) / s0
        a = abs(v[k]) * dt / g
        q = 1.0 - 0.5 * a if a < 1e-6 else (1.0 - math.exp(-a)) / a
        new = z * math.exp(-a) + v[k] * dt * q
        middle = 0.5 * (z + new)
        force[k] = s0 * middle + s1 * (new - z) / dt + s2 * v[k]
        bend[k] = abs(middle) * s0 / fs
        z = new
    return force, bend


def missing_force(
    u: np.ndarray, clean: np.ndarray, rate: float, motor_constant: float, base: dict[str, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force that the base model lacks along the noise-free motion, with velocity and bend (|z| over Fs/sigma0), at the
    inner samples, shape `(n - 2,)`."""
    dt = 1.0 / rate
    v = np.diff(clean) / dt
    names = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    force, bend = _friction(v, dt, tuple(float(base[name]) for name in names))
    # At sample k: the mean of the two intervals beside it, for the input as for friction.
    push = motor_constant * 0.5 * (u[1:-1] + u[:-2])
    lacks = push - base["J"] * np.diff(v) / dt - 0.5 * (force[1:] + force[:-1])
    return lacks, 0.5 * (v[1:] + v[:-1]), 0.5 * (bend[1:] + bend[:-1])


def regime_of(v: np.ndarray, bend: np.ndarray, vs: float, top: float) -> np.ndarray:
    """Index into `REGIMES` of each sample, by the map's own definitions; `top` is the fastest speed."""
    speed = np.abs(v)
    gross = speed > min(3.0 * vs, 0.3 * top)
    moving = (speed > min(0.3 * vs, 0.02 * top)) & (bend > 0.5)
    stuck = np.digitize(bend, [0.2, 0.8])
    return np.where(gross, 4, np.where(moving, 3, stuck))


def witness(truth: dict, verdict: dict) -> dict:
    """`ahead`: the oracle's error of each held-out recording (position units). `energy`: share of the squared force
    that the fitted base model lacks, without any noise of the sensor, in each regime."""
    case = simulated(truth, horizon=HORIZON)
    ahead, parts = {}, []
    base = {k: p["value"] for k, p in verdict.get("base", {}).get("parameters", {}).items()}
    for recording, hidden in zip(case.recordings, case.hidden, strict=True):
        if recording["role"] == "holdout":
            error = hidden.ahead - recording["x"]
            ahead[recording["name"]] = float(np.sqrt(np.nanmean(error**2)))
        if base:
            rate, km = recording["sample_rate"], case.plant["motor_constant"]
            lacks, v, bend = missing_force(recording["u"], hidden.clean, rate, km, base)
            weight = case.given.get("gravity_pendulum", {})  # what the case gives, its base model has
            x = hidden.clean[1:-1]
            lacks -= weight.get("sine", 0.0) * np.sin(x) + weight.get("cosine", 0.0) * np.cos(x)
            parts.append((lacks, v, bend))
    if not parts:
        return {"ahead": ahead, "energy": {}}
    lacks, v, bend = (np.concatenate([part[i] for part in parts]) for i in range(3))
    regime = regime_of(v, bend, base["vs"], float(np.quantile(np.abs(v), 0.999)))
    energy = np.bincount(regime, lacks**2, minlength=len(REGIMES))
    total = max(float(energy.sum()), 1e-300)
    shares = {name: float(part / total) for name, part in zip(REGIMES, energy, strict=True)}
    return {"ahead": ahead, "energy": shares}
