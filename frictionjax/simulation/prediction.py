"""`predict_ahead`: position some time ahead, predicted from the measurements so far.

A free run from the first sample accumulates every small error of the model; the innovation covers a single sample.
In between is the error after a stated time, from a state that the measurement has corrected.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int, Real

from frictionjax.core import require_x64
from frictionjax.core.safe import real
from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Start
from frictionjax.simulation.observer import ObservedMotion, ObserverGains, corrected_states, observe
from frictionjax.simulation.ros2 import DriveState, Substeps, advance

# Free runs in a batch: enough to fill the vector units, few enough to fit the cache.
_BATCH = 1024


def run_ahead(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    observed: ObservedMotion,
    dt: Float[Array, ""],
    gains: ObserverGains,
    *,
    horizon: int,
    stride: int,
    substeps: int = 1,
) -> Float[Array, " n"]:
    """`predict_ahead` from `observed`, a run of the observer with these `gains`; for use inside compiled functions."""
    n = observed.x.shape[0]
    runs = -(-(n - horizon) // stride)
    if runs <= 0:
        return observed.x
    begin = jnp.arange(runs) * stride
    first = jax.tree.map(lambda leaf: leaf[begin], corrected_states(drive, observed, gains))

    def one(run: tuple[DriveState, Int[Array, ""]]) -> Float[Array, " stride"]:
        return free_run(drive, force, *run, dt, horizon, stride, room=stride, substeps=substeps)

    ahead = jax.lax.map(one, (first, begin), batch_size=min(_BATCH, runs))
    return jnp.concatenate([observed.x[:horizon], ahead.reshape(-1)[: n - horizon]])


def free_run(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    state: DriveState,
    begin: Int[Array, ""],
    dt: Float[Array, ""],
    horizon: int | Int[Array, ""],
    stride: int | Int[Array, ""],
    *,
    room: int,
    substeps: Substeps = 1,
) -> Float[Array, " room"]:
    """Output of the sensor `horizon`, horizon + 1, ... horizon + `stride` - 1 samples after sample number `begin`, from
    the `state` there, in the first places of an array of shape `(room,)`; for use inside compiled functions.

    **Arguments:** `drive`, `force` (shape `(n,)`; the last is held beyond the recording), `dt`, `substeps` as in
    `predict_ahead`; `horizon` and `stride` may be numbers of the case.
    """
    bristles, last = drive.bristles(), mean_of(force).shape[0] - 1

    def sample(
        number: Int[Array, ""], carry: tuple[DriveState, Float[Array, " room"]]
    ) -> tuple[DriveState, Float[Array, " room"]]:
        state, passed = carry
        place = begin + number
        now = drive.measured(state.x, jnp.asarray(place, dtype=dt.dtype) * dt, state.hidden)
        passed = jax.lax.dynamic_update_slice(passed, now[None], (jnp.maximum(number - horizon, 0),))
        push = jax.tree.map(lambda leaf: leaf[jnp.minimum(place, last)], force)
        return advance(drive, bristles, state, push, dt, substeps), passed

    return jax.lax.fori_loop(0, horizon + stride, sample, (state, jnp.zeros(room)))[1]


@eqx.filter_jit
def _predict_ahead(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: ObserverGains,
    start: Start,
    horizon: int,
    stride: int,
    substeps: int,
) -> Float[Array, " n"]:
    observed = observe(drive, force, x, dt, gains, start, substeps=substeps)
    return run_ahead(drive, force, observed, dt, gains, horizon=horizon, stride=stride, substeps=substeps)


def predict_ahead(
    drive: Drive,
    force: Real[ArrayLike, "..."] | Push,
    x: Real[ArrayLike, "..."],
    dt: Real[ArrayLike, ""],
    gains: ObserverGains,
    start: Start,
    *,
    horizon: int,
    stride: int,
    substeps: int = 1,
) -> Float[Array, " n"]:
    """Position predicted `horizon` samples ahead (up to `stride` - 1 more), by free runs on the recorded force.

    At every `stride`-th sample k the drive starts from the state that the observer has corrected with x[k], and runs
    without measurement; its positions at samples k + horizon ... k + horizon + stride - 1 are returned there.

    **Arguments:**

    - `drive`: the `Drive`.
    - `force`: motor force held over each sample, shape `(n,)` (`drive.applied_force(u, dt)`).
    - `x`: measured position, shape `(n,)`.
    - `dt`: s per sample.
    - `gains`: from `observer_gains`.
    - `start`: position, velocity and bristle deflection at the first sample.
    - `horizon`: samples ahead, at least 1.
    - `stride`: samples from one start to the next, at least 1. The work grows as n (horizon + stride)/stride.
    - `substeps`: integration steps per sample.

    **Returns:**

    Predicted position, shape `(n,)`; the first `horizon` samples, which no run reaches, are the observer's predictions.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when `horizon` or `stride` is below 1, or when `force`
    and `x` are not of one length.
    """
    require_x64()
    applied, measured = jax.tree.map(real, force), real(x)
    if measured.ndim != 1 or mean_of(applied).shape != measured.shape:
        raise ValueError(
            f"`force` has shape {mean_of(applied).shape} and `x` {measured.shape}; both must be (n,)."
        )
    if horizon < 1 or stride < 1:
        raise ValueError(f"`horizon` is {horizon} and `stride` {stride}; both count samples and start at 1.")
    return _predict_ahead(
        drive,
        applied,
        measured,
        real(dt),
        jax.tree.map(real, gains),
        jax.tree.map(real, start),
        horizon,
        stride,
        substeps,
    )
