"""Innovations of several machines before the same recordings, as rows of one batch: `python -m benchmarks lanes`.

The same numbers by `vmap` over machines of `vmap` over recordings, whose loops run over two short axes.
"""

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.problem import DT, STAGE, drive_of, force, many
from benchmarks.timing import first_call, medians, row
from frictionjax import simulate
from frictionjax.simulation import innovations, observer_gains
from frictionjax.simulation.lanes import innovations_side_by_side

MACHINES, RECORDINGS = 6, 8


@jax.jit
def nested(drives, u, x, dt, gains, start):
    """Innovations, shape `(k, r, n)`, by two nested `vmap`s."""

    def one(drive, u, x, dt, gains, x0, v0, z0):
        return innovations(drive, drive.applied_force(u, dt), x, dt, gains, (x0, v0, z0))

    by_recording = jax.vmap(one, in_axes=(None, 0, 0, 0, 0, 0, 0, 0))
    by_machine = jax.vmap(by_recording, in_axes=(0, None, None, None, None, None, None, 0))
    return by_machine(drives, u, x, dt, gains, *start)


def measure(*, small: bool = False) -> list[dict]:
    """Both ways before the same recordings; `small`: short ones."""
    samples = 200 if small else 16000
    push = np.stack([np.roll(force(samples), 97 * k) for k in range(RECORDINGS)])
    x = jnp.stack([simulate(drive_of(STAGE), u, 1.0 / DT, substeps=1).x for u in push])
    drives = jax.vmap(drive_of)(jnp.asarray(many(MACHINES)))
    dt = jnp.full(RECORDINGS, DT)
    gains = observer_gains(jnp.full(RECORDINGS, 50.0), dt)
    start = (jnp.zeros(RECORDINGS), jnp.zeros(RECORDINGS), jnp.zeros((MACHINES, RECORDINGS)))
    both = {"nested": nested, "rows": jax.jit(innovations_side_by_side)}
    runs = {name: lambda f=f: f(drives, jnp.asarray(push), x, dt, gains, start) for name, f in both.items()}
    for run in runs.values():
        first_call(run)
    apart = float(jnp.max(jnp.abs(runs["nested"]() - runs["rows"]())) / jnp.max(jnp.abs(x)))
    seconds = medians(runs, repeats=5)
    each = 1e9 / (MACHINES * RECORDINGS * samples)
    ratio = seconds["nested"] / seconds["rows"]
    return [
        row(f"{MACHINES} machines, {RECORDINGS} recordings: nested", each * seconds["nested"], "ns a step"),
        row("as rows of one batch", each * seconds["rows"], "ns a step"),
        row("rows are faster by", ratio, "x"),
        row("largest difference, of the largest position", apart, "1", "below 1e-9", apart < 1e-9),
    ]
