"""Rival (c): sparse regression on the smoothed residual force (SINDy: sequentially thresholded least squares).

A library of plain terms in what is observed; the term that carries most of the residual names. Terms that a base
parameter could carry are in the library and name nothing.
"""

from __future__ import annotations

import numpy as np

from benchmarks.concealed.rivals.ground import Ground

_THRESHOLD = 0.1  # of the largest contribution
_ROUNDS = 10
_RIDGE = 1e-3
LEAST_R2 = 0.05
"""Share of the residual force that the chosen terms must explain, as in rival (a)."""


def thresholded(terms: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Sparse coefficients, shape `(k,)`, of `terms` `(m, k)` of unit rms for `force` `(m,)`."""
    active = np.ones(terms.shape[1], bool)
    coefficients = np.zeros(terms.shape[1])
    for _ in range(_ROUNDS):
        some = terms[:, active]
        gram = some.T @ some + _RIDGE * len(force) * np.eye(some.shape[1])
        coefficients = np.zeros(terms.shape[1])
        coefficients[active] = np.linalg.solve(gram, some.T @ force)
        large = np.abs(coefficients) > _THRESHOLD * np.max(np.abs(coefficients), initial=0.0)
        if np.array_equal(large, active) or not np.any(large):
            break
        active = large
    return coefficients


def period_of(force: np.ndarray, x: np.ndarray, speed: np.ndarray) -> float:
    """Period in position at which the residual force of moving samples is strongest, position units."""
    moving = speed > 0.05 * np.quantile(speed, 0.99)
    span = float(np.ptp(x[moving])) if np.any(moving) else 0.0
    if span <= 0.0:
        return 1.0
    edges = np.linspace(x[moving].min(), x[moving].max(), 257)
    place = np.clip(np.digitize(x[moving], edges) - 1, 0, 255)
    count = np.bincount(place, minlength=256)
    mean = np.bincount(place, force[moving], minlength=256) / np.maximum(count, 1)
    spectrum = np.abs(np.fft.rfft((mean - mean.mean()) * np.hanning(256)))[3:]
    return span / (3 + int(np.argmax(spectrum)))


def _slow(values: np.ndarray, dt: np.ndarray, time: float) -> np.ndarray:
    """First-order low-pass of each row, started at rest."""
    keep = np.exp(-dt / time)[:, None]
    out, state = np.empty_like(values), np.zeros((values.shape[0], 1))
    for k in range(values.shape[1]):
        state = keep * state + (1.0 - keep) * values[:, k : k + 1]
        out[:, k : k + 1] = state
    return out


def _library(ground: Ground, force: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """(effect or "" for a base parameter, values of shape `(r, n)`)."""
    motion, friction = ground.present.motion, ground.drive.friction
    x, v, z, a, u = (np.asarray(getattr(motion, name)) for name in ("x", "v", "z", "a", "u"))
    push, vs = np.asarray(motion.push), float(friction.vs)
    fitted = ~ground.held_out
    dt = np.asarray(ground.batch.dt)[fitted]
    clock = np.asarray(ground.batch.before.clock)[fitted][:, None] + np.arange(x.shape[1]) * dt[:, None]
    side, fast = v / (np.abs(v) + 0.05 * vs), np.exp(-((v / vs) ** 2))
    turn = 2.0 * np.pi * x / period_of(force.ravel(), x.ravel(), np.abs(v).ravel())
    reach = max(float(np.max(np.abs(x))), 1e-300)
    waves = [(np.sin(k * turn), np.cos(k * turn)) for k in (1, 2)]
    periodic = [wave for pair in waves for wave in pair]
    terms = [("", a), ("", v), ("", z), ("", side), ("", side * fast), ("", np.gradient(z, axis=1))]
    terms += [("constant_load", np.ones_like(x)), ("return_spring", x), ("quadratic_drag", v * np.abs(v))]
    terms += [("direction_asymmetry", np.abs(side)), ("direction_asymmetry", np.abs(v))]
    terms += [("load_dependence", np.abs(push) * side), ("nonlinear_bristle", z**3)]
    terms += [("position_dependence", side * (x / reach) ** k) for k in (1, 2)]
    terms += [("position_dependence", side * wave) for wave in periodic[:2]]
    terms += [("maxwell_slip", z * np.abs(z)), ("creep", _slow(z, dt, 1.0))]
    terms += [("stribeck_shape", side * np.exp(-np.abs(v) / vs))]
    terms += [("friction_lag", side * fast * np.abs(v) * a), ("warmup", side * np.exp(-clock / 60.0))]
    terms += [
        ("delay", np.gradient(push, axis=1)),
        ("drive_deadzone", np.sign(u)),
        ("drive_saturation", u**3),
    ]
    terms += [("flexible_transmission", np.gradient(np.gradient(a, axis=1), axis=1))]
    terms += [("ripple", wave) for wave in periodic] + [("torque_ripple", push * w) for w in periodic[:2]]
    if ground.case.plant.position_unit == "rad":
        terms += [("gravity_pendulum", np.sin(x)), ("gravity_pendulum", np.cos(x))]
    return terms


def by_sparse_regression(ground: Ground) -> dict:
    """The effect whose terms are largest, or none; what all chosen terms explain, and what each effect's carry (terms
    that are alike may cancel: these do not add up)."""
    inside = np.asarray(ground.present.posterior.batch.valid) > 0
    force = ground.base_view.force[~ground.held_out]
    library = _library(ground, force)
    # The smoothed force has a bandwidth of 25 Hz: every fifth sample of the fastest rate in use holds all of it.
    chosen = np.flatnonzero(inside.ravel())[::5]
    y = np.nan_to_num(force.ravel()[chosen])
    columns = np.stack([np.nan_to_num(values.ravel()[chosen]) for _, values in library], axis=1)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    terms = columns / np.where(scale > 0.0, scale, 1.0)
    coefficients = thresholded(terms, y) * (scale > 0.0)
    power = max(float(np.mean(y**2)), 1e-300)
    explained = 1.0 - float(np.mean((y - terms @ coefficients) ** 2)) / power
    carried: dict[str, float] = {}
    for (effect, _), coefficient in zip(library, coefficients, strict=True):
        if effect and coefficient != 0.0:
            carried[effect] = carried.get(effect, 0.0) + float(coefficient**2) / power
    first = max(carried, key=lambda name: carried[name], default="")
    named = first if first and explained > LEAST_R2 else None
    rounded = {name: round(value, 5) for name, value in carried.items()}
    return {"named": named, "explained": round(explained, 5), "carried": rounded}
