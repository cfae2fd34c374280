"""Throughput on a GPU: `python -m benchmarks simulation_gpu`. Without one it says so and measures nothing.

Two roads: `simulate_batch` (a `lax.scan`, every operation of a step a kernel or part of one) and one Pallas kernel that
has the time loop, each thread block its drives, and the state stays in registers.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental import pallas as pl

from benchmarks.problem import DT, SAMPLE_RATE, drive_of, force, last, many
from benchmarks.timing import first_call, medians, row
from frictionjax import simulate_batch
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import advance

LANES = 128
NO_GPU = "simulation_gpu: JAX finds no GPU here, so nothing was measured. Run it where `jax.devices('gpu')` lists one."
# Multiplications, additions, comparisons of one step, divisions and exponentials counted as 20 each; from the source.
OPERATIONS = 240.0


def _kernel(parameters_ref, force_ref, out_ref, *, samples: int):
    """All steps of one block of drives; `parameters_ref` (7, lanes), `force_ref` (n,), `out_ref` (lanes,)."""
    values = tuple(parameters_ref[i, :] for i in range(7))

    def step(k, state):
        def one(p, x, v, z):
            drive = drive_of(p)
            start = initial_state(drive, x, v, z)
            after = advance(drive, drive.bristles(), start, force_ref[k], jnp.asarray(DT), 1)
            return after.x, after.v, after.bristle

        return jax.vmap(one)(values, *state)

    rest = jnp.zeros(values[0].shape)
    out_ref[:] = jax.lax.fori_loop(0, samples - 1, step, (rest, rest, rest))[0]


@partial(jax.jit, static_argnames=("interpret",))
def one_kernel(parameters, push, *, interpret: bool = False):
    """The last position of all drives by one kernel, shape (b,); `parameters` (7, b), b a multiple of 128."""
    count, samples = parameters.shape[1], push.shape[0]
    return pl.pallas_call(
        partial(_kernel, samples=samples),
        out_shape=jax.ShapeDtypeStruct((count,), parameters.dtype),
        grid=(count // LANES,),
        in_specs=[
            pl.BlockSpec((7, LANES), lambda i: (0, i)),
            pl.BlockSpec((samples,), lambda i: (0,)),
        ],
        out_specs=pl.BlockSpec((LANES,), lambda i: (i,)),
        interpret=interpret,
    )(parameters, push)


def measure(*, small: bool = False) -> list[dict]:
    """The rows, or a sentence that there is no GPU."""
    if jax.default_backend() != "gpu":
        return [{"note": NO_GPU}]
    count, samples = (2560, 200) if small else (100_352, 2000)
    push = force(samples)
    table = jnp.asarray(many(count).T)
    drives = drive_of(table)
    steps = count * samples
    runs = {"scan": lambda: simulate_batch(drives, push, SAMPLE_RATE, substeps=1, of=last)}
    label = f"{count} drives x {samples} steps, float64"
    rows, notes = [], []
    compiling = {"scan": first_call(runs["scan"])}
    try:
        compiling["pallas"] = first_call(lambda: one_kernel(table, jnp.asarray(push)))
        runs["pallas"] = lambda: one_kernel(table, jnp.asarray(push))
    except Exception as error:  # a lowering that is missing is a result to write down, whatever its type
        notes.append(
            {"note": f"The Pallas kernel does not compile here: {type(error).__name__}: {str(error)[:300]}"}
        )
    seconds = medians(runs, repeats=5)
    for name, value in seconds.items():
        rows.append(row(f"{label}: {name}", 1e9 * value / steps, "ns a step and drive"))
        rows.append(row(f"{label}: {name}, first call", compiling[name], "s"))
        rows.append(
            row(
                f"{label}: {name}, arithmetic at {OPERATIONS:g} a step",
                OPERATIONS * steps / value / 1e12,
                "TFLOP/s",
            )
        )
    if "pallas" in seconds:
        rows.append(
            row(f"{label}: one kernel is faster than scan by", seconds["scan"] / seconds["pallas"], "x")
        )
        apart = np.max(np.abs(np.asarray(runs["pallas"]()) - runs["scan"]()))
        rows.append(row(f"{label}: the two differ by", float(apart), "m"))
    few = 1024
    with jax.default_device(jax.devices("cpu")[0]):
        on_cpu = drive_of(jnp.asarray(many(few).T))
        vmapped = jax.jit(jax.vmap(lambda d: _last_on_cpu(d, push)))
        first_call(lambda: vmapped(on_cpu))
        processor = medians({"cpu": lambda: vmapped(on_cpu)}, repeats=3)["cpu"] / few
    rows.append(
        row(
            f"{label}: times the processor of this machine (vmap, one device)",
            processor * count / min(seconds.values()),
            "x",
        )
    )
    return rows + notes


def _last_on_cpu(drive, push):
    from frictionjax import simulate

    return simulate(drive, push, SAMPLE_RATE, substeps=1).x[-1]
