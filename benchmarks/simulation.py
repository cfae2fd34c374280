"""Throughput of simulations on the processor: `python -m benchmarks simulation`.

float64 everywhere. The C and numba loops run the same scheme with the same steps, so their error is ours; the table
says how far they are apart. `solvers.py` has the solvers with an error of their own.
"""

import importlib.util

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import DT, SAMPLE_RATE, STAGE, drive_of, force, last, many
from benchmarks.rivals import c_loop
from benchmarks.timing import CORES, first_call, medians, row
from frictionjax import simulate, simulate_batch

_HAS = {name: importlib.util.find_spec(name) is not None for name in ("numba",)}
_MISSING = "not installed: pip install '.[bench]'"


def batches(small: bool) -> list[dict]:
    """A batch of drives, last position or every position: against C and numba on the same cores."""
    rows = []
    samples = 200 if small else 2000
    push = force(samples)
    for count in (128,) if small else (1024, 4096):
        parameters = many(count)
        drives = drive_of(jnp.asarray(parameters.T))
        for keep_all, what in ((False, "last x"), (True, "all x")):
            kept = {} if keep_all else {"of": last}
            runs = {"ours": lambda d=drives, k=kept: simulate_batch(d, push, SAMPLE_RATE, substeps=1, **k)}
            if c_loop.available():
                library = c_loop.build()
                runs["C"] = c_loop.runner(library, parameters, push, DT, substeps=1, keep_all=keep_all)
            if _HAS["numba"]:
                from benchmarks.rivals import numba_loop

                shape = (count, samples) if keep_all else (count,)
                loop = numba_loop.simulate_all if keep_all else numba_loop.simulate_last
                out = np.empty(shape)
                runs["numba"] = lambda p=parameters, o=out, f=loop: (f(p, push, DT, 1, o), o)[1]
            compiling = {name: first_call(run) for name, run in runs.items()}
            values = {name: np.array(run()) for name, run in runs.items()}
            seconds = medians(runs, repeats=21)
            label = f"{count} drives x {samples} steps, {what}"
            each = {name: 1e9 * s / count / samples for name, s in seconds.items()}
            rows.append(row(f"{label}: frictionjax", each["ours"], "ns a step and drive"))
            rows.append(row(f"{label}: frictionjax, first call", compiling["ours"], "s"))
            if "C" in runs:
                theirs = values["C"].T if keep_all else values["C"]
                ratio = seconds["ours"] / seconds["C"]
                rows.append(row(f"{label}: C, {CORES} cores", each["C"], "ns a step and drive"))
                rows.append(row(f"{label}: time over that of C", ratio, "x", "at most 2", ratio <= 2.0))
                rows.append(_apart(label + ": C", values["ours"], theirs))
            else:
                rows.append(row(f"{label}: C ({c_loop.MISSING})", np.nan, "x"))
            if "numba" in runs:
                ratio = seconds["numba"] / seconds["ours"]
                rows.append(row(f"{label}: numba prange", each["numba"], "ns a step and drive"))
                rows.append(row(f"{label}: faster than numba prange", ratio, "x", "at least 4", ratio >= 4.0))
                rows.append(_apart(label + ": numba", values["ours"], values["numba"]))
            else:
                rows.append(row(f"{label}: numba ({_MISSING})", np.nan, "x"))
    return rows


def _apart(what: str, ours, theirs) -> dict:
    """How far two implementations of one scheme are apart, over the size of the motion."""
    apart = float(np.max(np.abs(ours - theirs)) / np.max(np.abs(ours)))
    return row(f"{what}, largest difference over the motion", apart, "1", "below 1e-6", apart < 1e-6)


@eqx.filter_jit
def _free(drive, push):
    return simulate(drive, push, SAMPLE_RATE, substeps=1).x


@eqx.filter_jit
def _position(logs, push):
    return simulate(drive_of(jnp.exp(logs) * STAGE), push, SAMPLE_RATE, substeps=2).x


@eqx.filter_jit
def _with_jacobian(logs, push):
    """x and its derivatives: the run is made once, its seven tangents go along side by side."""
    along = jax.vmap(lambda one: jax.jvp(lambda q: _position(q, push), (logs,), (one,)), out_axes=(None, 0))
    return along(jnp.eye(7))


@eqx.filter_jit
def _gradient(logs, push, x):
    return jax.grad(lambda q: jnp.sum((_position(q, push) - x) ** 2))(logs)


def one_record(small: bool) -> list[dict]:
    """One long recording: a free run, and the run with its Jacobian by seven parameters."""
    samples = 2000 if small else 32_000
    push, zero = jnp.asarray(force(samples)), jnp.zeros(7)
    x = _position(zero, push)
    drive = drive_of(STAGE)

    runs = {
        "free": lambda: _free(drive, push),
        "everything": lambda: jax.tree.leaves(simulate(drive, push, SAMPLE_RATE, substeps=1)),
        "jacobian": lambda: _with_jacobian(zero, push),
        "gradient": lambda: _gradient(zero, push, 1.001 * x),
    }
    compiling = {name: first_call(run) for name, run in runs.items()}
    if _HAS["numba"]:
        from benchmarks.rivals import numba_loop

        out, table, plain = np.empty(samples), np.empty((8, samples)), np.asarray(push)
        runs["numba free"] = lambda: numba_loop.simulate(STAGE, plain, DT, 1, out)
        runs["numba jacobian"] = lambda: numba_loop.jacobian(STAGE, plain, DT, 2, 1e-5, table)
        for name in ("numba free", "numba jacobian"):
            first_call(runs[name])
    if c_loop.available():
        moved = np.concatenate([STAGE[None], STAGE * np.exp(1e-5 * np.eye(7))])
        runs["C jacobian"] = c_loop.runner(
            c_loop.build(8), moved, np.asarray(push), DT, substeps=2, keep_all=True, lanes=8
        )
        first_call(runs["C jacobian"])
    seconds = medians(runs)
    label = f"one record of {samples}"
    rows = [
        row(f"{label}: free run, x", 1e9 * seconds["free"] / samples, "ns a step"),
        row(f"{label}: `simulate`, with v, z, friction", 1e9 * seconds["everything"] / samples, "ns a step"),
        row(f"{label}: free run, first call", compiling["free"], "s"),
        row(
            f"{label}, two steps a sample: x and its Jacobian in 7 parameters",
            1e3 * seconds["jacobian"],
            "ms",
        ),
        row(f"{label}: Jacobian, first call", compiling["jacobian"], "s"),
        row(
            f"{label}, two steps a sample: gradient of a misfit, reverse mode",
            1e3 * seconds["gradient"],
            "ms",
        ),
    ]
    if _HAS["numba"]:
        ratio = seconds["free"] / seconds["numba free"]
        rows.append(row(f"{label}: numba, free run, x", 1e9 * seconds["numba free"] / samples, "ns a step"))
        rows.append(
            row(f"{label}: free run, x, time over that of numba", ratio, "x", "at most 2", ratio <= 2.0)
        )
        ratio = seconds["jacobian"] / seconds["numba jacobian"]
        rows.append(row(f"{label}: numba, differences", 1e3 * seconds["numba jacobian"], "ms"))
        rows.append(row(f"{label}: Jacobian, time over that of numba", ratio, "x", "at most 1", ratio <= 1.0))
    if c_loop.available():
        ratio = seconds["jacobian"] / seconds["C jacobian"]
        rows.append(
            row(f"{label}: C, differences side by side in 8 lanes", 1e3 * seconds["C jacobian"], "ms")
        )
        rows.append(row(f"{label}: Jacobian, time over that of C", ratio, "x"))
    return rows


def memory(small: bool) -> list[dict]:
    """Bytes that compiled programs allocate besides inputs and results."""
    count, samples = (64, 200) if small else (1024, 2000)
    push = jnp.asarray(force(samples))

    def misfit(logs, push):
        x = simulate_batch(drive_of(jnp.exp(logs) * STAGE[:, None]), push, SAMPLE_RATE, of=last)
        return jnp.sum(x**2)

    rows, held = [], {}
    for parameters in (1, 7):

        def gradient(free, push):
            def of(free):
                logs = jnp.zeros((7, count)).at[: free.shape[0]].set(free[:, None])
                return misfit(logs, push)

            # One parameter after the other: in parallel, each would need a batch of its own.
            return jax.lax.map(lambda one: jax.jvp(of, (free,), (one,))[1], jnp.eye(free.size))

        program = jax.jit(gradient).lower(jnp.zeros(parameters), push).compile()
        held[parameters] = program.memory_analysis().temp_size_in_bytes
        rows.append(
            row(
                f"{count} drives x {samples} steps: held for a derivative in {parameters}",
                held[parameters] / 2**20,
                "MiB",
            )
        )
    return rows


def measure(*, small: bool = False) -> list[dict]:
    """All rows; `small`: small sizes that only show that it runs."""
    return batches(small) + one_record(small) + memory(small)
