"""Our batches against general solvers and MuJoCo: `python -m benchmarks solvers`.

Two of our steps a sample. Each rival is given the tightest setting of a ladder at which its error is still not below
ours, which is the fairest that is not to our disadvantage.
"""

import importlib.util

import jax.numpy as jnp
import numpy as np

from benchmarks.problem import DT, SAMPLE_RATE, STAGE, drive_of, force, many, rms
from benchmarks.rivals import diffrax_kvaerno, scipy_lsoda
from benchmarks.timing import CORES, first_call, medians, row
from frictionjax import simulate, simulate_batch
from frictionjax.simulation import simulate_reference


def _per_step(count: int, samples: int, push) -> float:
    """Seconds a sample and drive of our batch at two steps a sample, all positions kept."""
    drives = drive_of(jnp.asarray(many(count).T))

    def run():
        return simulate_batch(drives, push, SAMPLE_RATE, substeps=2)

    first_call(run)
    return medians({"ours": run}, repeats=5)["ours"] / count / samples


def measure(*, small: bool = False) -> list[dict]:
    """All rows; `small`: small sizes that only show that it runs."""
    samples = 60 if small else 200
    push = force(samples)
    exact = simulate_reference(drive_of(STAGE), push, SAMPLE_RATE, rtol=1e-10, atol=1e-13).x
    ours = simulate(drive_of(STAGE), push, SAMPLE_RATE, substeps=2).x
    error = rms(ours - exact)
    each = _per_step(128 if small else 1024, samples, push)
    rows = [row("two steps a sample: frictionjax, error of x", 1e9 * error, "nm rms")]

    def compare(name, seconds, theirs, goal):
        ratio = seconds / each
        rows.append(row(f"{name}: error of x", 1e9 * theirs, "nm rms", "not below ours", theirs >= error))
        rows.append(row(f"{name}: frictionjax is faster by", ratio, "x", f"at least {goal}", ratio >= goal))

    few = jnp.asarray(many(8))
    few = few.at[0].set(STAGE)
    chosen = _loosest(lambda rtol: diffrax_kvaerno.simulate_all(few[:1], push, DT, rtol)[0], exact, error)
    tolerance = jnp.asarray(chosen)

    def kvaerno():
        return diffrax_kvaerno.simulate_all(few, jnp.asarray(push), DT, tolerance)

    first_call(kvaerno)
    seconds = medians({"it": kvaerno}, repeats=3)["it"] / 8 / samples
    compare(f"diffrax Kvaerno5, PID {chosen:g}, vmap of 8", seconds, rms(kvaerno()[0] - exact), 100)

    chosen = _loosest(lambda rtol: scipy_lsoda.simulate(STAGE, push, DT, rtol), exact, error)
    seconds = (
        medians({"it": lambda: scipy_lsoda.simulate(STAGE, push, DT, chosen)}, repeats=3)["it"] / samples
    )
    compare(
        f"scipy LSODA, rtol {chosen:g}",
        seconds,
        rms(scipy_lsoda.simulate(STAGE, push, DT, chosen) - exact),
        1000,
    )

    if importlib.util.find_spec("mujoco") is None:
        return [*rows, row("MuJoCo (not installed: pip install '.[bench]')", np.nan, "x")]
    from benchmarks.rivals import mujoco_lugre

    count = 8 if small else 64
    parameters = many(count)
    parameters[0] = STAGE
    run = mujoco_lugre.runner(parameters, push, DT, CORES)
    error_there = rms(run()[0] - exact)
    seconds = medians({"it": run}, repeats=5)["it"] / count / samples
    compare(f"MuJoCo Euler, one step a sample, {CORES} threads", seconds, error_there, 3)
    return rows


def _loosest(simulated, exact, error: float) -> float:
    """The tightest tolerance at which a solver's error is still not below ours; the loosest if none is so poor."""
    ladder = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
    usable = [rtol for rtol in ladder if rms(simulated(rtol) - exact) >= error]
    return usable[-1] if usable else ladder[0]
