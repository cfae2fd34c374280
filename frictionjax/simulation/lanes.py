"""Innovations of several machines on the same recordings, as rows of one batch.

A loop over one long axis fills the vector units; one over two short axes, machines and recordings, takes more than
twice as long for the same numbers (`python -m benchmarks lanes`). Inputs that all machines share are repeated
inside the loop.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation.fixed import state_at
from frictionjax.simulation.observer import ObserverGains, innovation_step
from frictionjax.simulation.ros2 import DriveState, Substeps
from frictionjax.simulation.samples import scan_samples

Starts = (
    tuple[Float[Array, " r"], Float[Array, " r"], Float[Array, "k r"]]
    | tuple[Float[Array, " r"], Float[Array, " r"], Float[Array, "k r"], Before]
)
"""`Start` of `k` machines in each of `r` recordings: only the deflection of the bristle differs between machines."""


def tiled(tree: PyTree, count: int) -> PyTree:
    """Every array of a `tree` tiled `count` times along its rows (a b a b); inside compiled functions."""
    return jax.tree.map(lambda leaf: jnp.tile(leaf, (count, *[1] * (leaf.ndim - 1))), tree)


def repeated(tree: PyTree, count: int) -> PyTree:
    """Every row of every array of a `tree` repeated `count` times (a a b b); inside compiled functions."""
    return jax.tree.map(lambda leaf: jnp.repeat(leaf, count, axis=0), tree)


def rows_along(
    step: Callable,
    count: int,
    fixed: PyTree,
    begin: PyTree,
    shared: PyTree,
    own: PyTree,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, "kr n"]:
    """Scan `step` along the samples of `count` times `r` rows; for use inside compiled functions.

    **Arguments:**

    - `step`: `(fixed, state, shared, own) -> (state, output)` of one row at one sample.
    - `count`: how often the rows of `shared` are repeated.
    - `fixed`, `begin`: constants and first state, arrays of shape `(count r, ...)`.
    - `shared`, `own`: inputs, arrays of shape `(r, n)`, and of shape `(count r, n)`.
    - `samples`: as in `scan_samples`.
    """

    def sample(state, inputs):
        here, mine = inputs
        return jax.vmap(step)(fixed, state, tiled(here, count), mine)

    return scan_samples(sample, begin, jax.tree.map(jnp.transpose, (shared, own)), samples).T


def start_rows(drives: Drive, z0: Float[Array, "k r"], start: Starts) -> tuple[Drive, DriveState]:
    """Each of the `drives`, leaves of shape `(k, ...)`, at the first sample of each recording: the drives by rows, and
    their states there; `start` as in `innovations_side_by_side`."""
    count, recordings = z0.shape
    rows = repeated(drives, recordings)
    x0, v0, *before = tiled((start[0], start[1], *start[3:]), count)

    def first(drive, x, v, z, *before):
        return state_at(drive, (x, v, z, *before))

    return rows, jax.vmap(first)(rows, x0, v0, z0.ravel(), *before)


def innovations_side_by_side(
    drives: Drive,
    u: Float[Array, "r n"],
    x: Float[Array, "r n"],
    dt: Float[Array, " r"],
    gains: ObserverGains,
    start: Starts,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, "k r n"]:
    """The `innovations` of each of `k` drives in each of `r` recordings; for use inside compiled functions.

    **Arguments:**

    - `drives`: leaves of shape `(k, ...)`.
    - `u`, `x`: recorded input and measured position.
    - `dt`: s per sample.
    - `gains`: of the observer, one per recording, or one per sample.
    - `start`: position and velocity at the first sample, shape `(r,)`, the bristle's deflection there, shape `(k, r)`,
        and the history before (leaves of leading size `r`).
    - `substeps`: integration steps per sample.
    - `samples`: as in `scan_samples`.
    """
    z0 = start[2]
    count, recordings = z0.shape
    rows, begin = start_rows(drives, z0, start)
    times = tiled(dt, count)
    force = jax.vmap(lambda drive, u, dt: drive.applied_force(u, dt))(rows, jnp.tile(u, (count, 1)), times)

    def step(fixed, state, shared, push):
        drive, dt = fixed
        return innovation_step(drive, dt, substeps)(state, (push, *shared))

    t = jnp.arange(x.shape[1], dtype=x.dtype)[None] * dt[:, None]
    found = rows_along(step, count, (rows, times), begin, (x, t, gains.along(*x.shape)), force, samples)
    return found.reshape(count, recordings, -1)
