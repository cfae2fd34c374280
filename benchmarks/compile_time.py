"""What the first call of each verb costs, and what the same call with other numbers costs.

    python -m benchmarks compile_time

One process, one verb after the other, nothing kept from earlier runs: small programs that two verbs share count for the
first. Small cases: what is measured is the compilation. `diagnose` has a file of its own.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from benchmarks.timing import all_compiled_anew, row
from frictionjax import (
    Drive,
    LuGre,
    Recording,
    best_linear_approximation,
    compare_estimators,
    estimate_frf,
    excitation,
    fit,
    fit_sk,
    level_sweep,
    linearize,
    simulate,
    simulate_batch,
)
from frictionjax.core.compile_time import CompileClock
from frictionjax.simulation import observer_gains, predict_ahead, simulate_reference

RATES = (2000.0, 1900.0)
N = 4000

Call = Callable[[], object]


def _drive(k: int) -> Drive:
    """A servo arm in N m, rad, s and V; `k` makes it another one of the same structure."""
    friction = LuGre(
        sigma0=2000.0 + 100.0 * k, sigma1=6.0, sigma2=0.06 + 0.01 * k, Fc=0.5 + 0.02 * k, Fs=0.62, vs=0.06
    )
    return Drive(0.03 + 0.002 * k, friction, 16.0)


def _noise(k: int, n: int = N, level: float = 6e-3) -> np.ndarray:
    """Input well below break-away, V."""
    return level * np.random.default_rng(k).standard_normal(n)


def _simulate(k: int) -> Call:
    drive, u = _drive(k), _noise(k)
    return lambda: simulate(drive, u, RATES[k])


def _simulate_batch(k: int) -> Call:
    drive, u = _drive(k), _noise(k)
    drives = Drive(drive.J * np.linspace(0.9, 1.1, 16), drive.friction, drive.motor_constant)
    return lambda: simulate_batch(drives, u, RATES[k])


def _simulate_reference(k: int) -> Call:
    drive, u = _drive(k), _noise(k, 40)
    return lambda: simulate_reference(drive, u, RATES[k])


def _predict_ahead(k: int) -> Call:
    gains = observer_gains(50.0, 1.0 / RATES[k])
    drive, force, x = _drive(k), 16.0 * _noise(k), 1e-6 * _noise(k, level=1.0)
    start = (0.0, 0.0, 0.0)
    return lambda: predict_ahead(drive, force, x, 1.0 / RATES[k], gains, start, horizon=200, stride=5)


def _linearize(k: int) -> Call:
    drive = _drive(k)
    return lambda: linearize(drive, z=1e-6 * k)


def _response(k: int):
    u = _noise(k)
    return u, np.asarray(simulate(_drive(k), u, RATES[k]).x)


def _estimate_frf(k: int) -> Call:
    u, x = _response(k)
    return lambda: estimate_frf(u, x, RATES[k], segment=1024)


def _fit_sk(k: int) -> Call:
    frf = estimate_frf(*_response(k), RATES[k], segment=1024)
    return lambda: fit_sk(frf, (3.0, 150.0), motor_constant=16.0)


def _best_linear_approximation(k: int) -> Call:
    u = np.tile(_noise(k, 500), 8)
    x = np.asarray(simulate(_drive(k), u, RATES[k]).x)
    lines = np.arange(1, 40, 2)
    return lambda: best_linear_approximation(u, x, RATES[k], period=500, lines=lines)


def _prbs(k: int) -> Call:
    return lambda: excitation.prbs(jax.random.key(k), N, RATES[k], 0.2 * RATES[k], 6e-3 + 1e-3 * k)


def _gaussian_noise(k: int) -> Call:
    return lambda: excitation.gaussian_noise(jax.random.key(k), N, RATES[k], 300.0, 6e-3 + 1e-3 * k)


def _multisine(k: int) -> Call:
    band = (0.005 * RATES[k], 0.1 * RATES[k])
    return lambda: excitation.multisine(jax.random.key(k), N, RATES[k], band, 6e-3 + 1e-3 * k)


def _point_to_point(k: int) -> Call:
    return lambda: excitation.point_to_point(N, RATES[k], [0.3, -0.1 - 0.1 * k], 0.3, rests=0.2)


def _level_sweep(k: int) -> Call:
    drive, settings = _drive(k), {"seeds": 2, "averages": 4, "sample_rate": 2000.0, "segment": 1024}
    return lambda: level_sweep(drive, levels=(0.05, 0.3 + 0.1 * k), seed=k, **settings)


def _compare_estimators(k: int) -> Call:
    return lambda: compare_estimators(draws=3, levels=((1e-3,), (2e-3,))[k], seed=k).estimates


def _fit(k: int) -> Call:
    """Two recordings of 0.6 s: a ramp through break-away and back, and a noise that slides."""
    t, rng = np.arange(1200) / 2000.0, np.random.default_rng(k)
    found = []
    for name, u in (("ramp", 0.06 * np.sin(2.0 * np.pi * t / 0.6)), ("noise", _noise(k, 1200, 0.03))):
        x = np.asarray(simulate(_drive(0), u, 2000.0).x) + 1e-6 * rng.standard_normal(t.size)
        found.append(Recording(name, 2000.0, u, x))
    start = _drive(1 + k)
    return lambda: fit(start, found, encoder_step=1e-9)


VERBS: dict[str, Callable[[int], Call]] = {
    "simulate": _simulate,
    "simulate_batch": _simulate_batch,
    "simulate_reference": _simulate_reference,
    "predict_ahead": _predict_ahead,
    "linearize": _linearize,
    "estimate_frf": _estimate_frf,
    "fit_sk": _fit_sk,
    "best_linear_approximation": _best_linear_approximation,
    "excitation.prbs": _prbs,
    "excitation.gaussian_noise": _gaussian_noise,
    "excitation.multisine": _multisine,
    "excitation.point_to_point": _point_to_point,
    "level_sweep": _level_sweep,
    "fit": _fit,
    "compare_estimators": _compare_estimators,
}
"""What prepares a call of each verb: with one set of numbers for 0, with another for 1."""


def _timed(call: Call) -> float:
    started = time.perf_counter()
    jax.block_until_ready(jax.tree.leaves(call()))
    return time.perf_counter() - started


def measure(*, small: bool = False) -> list[dict[str, Any]]:
    """Rows for each verb: its first call, how much of that was compilation, and a call with other numbers.

    Forgets what was compiled before. `small`: the first four verbs only.
    """
    rows = []
    with all_compiled_anew():
        for verb, prepare in list(VERBS.items())[: 4 if small else None]:
            first, second = prepare(0), prepare(1)
            clock = CompileClock()
            rows.append(row(f"{verb}: first call", _timed(first), "s"))
            rows.append(row(f"{verb}: of that compilation", clock.seconds, "s"))
            rows.append(row(f"{verb}: other numbers", 1e3 * _timed(second), "ms"))
    return rows
