"""Error of the production scheme against its step, and what it does to a fit: `python -m benchmarks accuracy`.

The reference is diffrax's Kvaerno5 at 1e-11 with every input change declared; tests/simulation/test_accuracy.py holds
it, and the scheme, against scipy's Radau on equations written out again.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import NAMES, SAMPLE_RATE, STAGE, drive_of, force, rms
from benchmarks.timing import row
from frictionjax import simulate
from frictionjax.simulation import simulate_reference

STEPS = (1, 2, 4, 8)


def _inputs(samples: int) -> dict[str, np.ndarray]:
    """Force over the break-away force, for each kind of experiment."""
    t = np.arange(samples) / SAMPLE_RATE
    rate = 2.0 / t[-1]
    return {
        "presliding loop": 0.9 * np.sin(2 * np.pi * rate * t),
        "break-away ramp": 1.5 * t / t[-1],
        "stick and slip": 1.3 * np.sin(2 * np.pi * rate * t),
        "sliding moves": 3.0 * np.sign(np.sin(2 * np.pi * rate * t + 1e-9)),
        "noise below break-away": 0.3 * np.random.default_rng(1).normal(size=samples),
        "noise above break-away": 0.7 * np.random.default_rng(1).normal(size=samples),
    }


def errors(small: bool) -> list[dict]:
    """Position error of 1 to 8 steps a sample, and the order that they show."""
    rows, drive = [], drive_of(STAGE)
    for name, relative in _inputs(60 if small else 200).items():
        push = STAGE[5] * relative
        exact = simulate_reference(drive, push, SAMPLE_RATE, rtol=1e-11, atol=1e-14).x
        found = [rms(simulate(drive, push, SAMPLE_RATE, substeps=n).x - exact) for n in STEPS]
        for n, error in zip(STEPS, found, strict=True):
            rows.append(row(f"{name}, {n} a sample: error of x over the motion", error / np.ptp(exact), "1"))
        order = -np.polyfit(np.log(STEPS), np.log(found), 1)[0]
        rows.append(row(f"{name}: order of the error", order, "1", "above 1.6", order > 1.6))
    return rows


WEIGHTS = (2.5e-7, 9e-6)
"""What a recording of noise and one of slow break-aways are weighed by, m: encoder and process noise of a good rig."""


@eqx.filter_jit
def _misfit(logs, pushes, measured, substeps):
    drive = drive_of(jnp.exp(logs) * STAGE)
    runs = [simulate(drive, push, SAMPLE_RATE, substeps=substeps).x for push in pushes]
    return jnp.concatenate(
        [(run - x) / weight for run, x, weight in zip(runs, measured, WEIGHTS, strict=True)]
    )


@eqx.filter_jit
def _gauss_newton(logs, pushes, measured, substeps):
    columns = jax.jacfwd(_misfit)(logs, pushes, measured, substeps)
    length = jnp.linalg.norm(columns, axis=0)
    return logs - jnp.linalg.lstsq(columns / length, _misfit(logs, pushes, measured, substeps))[0] / length


def biases(small: bool) -> list[dict]:
    """What a fit with too few steps makes of the parameters; data without noise, made with 64 steps a sample."""
    samples = 500 if small else 6000
    t = np.arange(samples) / SAMPLE_RATE
    pushes = [jnp.asarray(force(samples)), jnp.asarray(1.4 * STAGE[5] * np.sin(2 * np.pi * 0.75 * t))]
    measured = [simulate(drive_of(STAGE), push, SAMPLE_RATE, substeps=64).x for push in pushes]
    rows = []
    for substeps in (1, 2, 4):
        logs = jnp.zeros(7)
        for _ in range(6):
            logs = _gauss_newton(logs, pushes, measured, substeps)
        for name, value in zip(NAMES, 100.0 * np.expm1(np.asarray(logs)), strict=True):
            if name in ("sigma1", "sigma2", "vs"):
                rows.append(row(f"fit with {substeps} a sample: error of {name}", value, "%"))
    return rows


def measure(*, small: bool = False) -> list[dict]:
    """All rows."""
    return errors(small) + biases(small)
