"""`predict_ahead`: position some time ahead, predicted from the measurements so far.

A free run from the first sample accumulates every small error of the model; the innovation covers a single sample.
In between is the error after a stated time, from a state that the measurement has corrected.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Real

from frictionjax.core import require_x64
from frictionjax.core.safe import real
from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Start
from frictionjax.simulation.observer import Gains, Observed, corrected_states, observe
from frictionjax.simulation.ros2 import advance

# Free runs in a batch: enough to fill the vector units, few enough to fit the cache.
_BATCH = 1024


def run_ahead(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    observed: Observed,
    dt: Float[Array, ""],
    gains: Gains,
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
    bristles = drive.bristles()
    begin = jnp.arange(runs) * stride
    first = jax.tree.map(lambda leaf: leaf[begin], corrected_states(drive, observed, gains))
    # The last run may extend beyond the recording: its prediction there is cut off below.
    padded = jax.tree.map(lambda leaf: jnp.concatenate([leaf, jnp.zeros(stride)]), force)

    def free_run(state, begin):
        def sample(state, inputs):
            push, t = inputs
            return advance(drive, bristles, state, push, dt, substeps), drive.measured(
                state.x, t, state.hidden
            )

        push = jax.tree.map(
            lambda leaf: jax.lax.dynamic_slice(leaf, (begin,), (horizon + stride - 1,)), padded
        )
        t = jnp.asarray(begin + jnp.arange(horizon + stride), dtype=dt.dtype) * dt
        state, passed = jax.lax.scan(sample, state, (push, t[:-1]))
        return jnp.concatenate([passed[horizon:], drive.measured(state.x, t[-1], state.hidden)[None]])

    ahead = jax.lax.map(lambda run: free_run(*run), (first, begin), batch_size=min(_BATCH, runs))
    return jnp.concatenate([observed.x[:horizon], ahead.reshape(-1)[: n - horizon]])


@eqx.filter_jit
def _predict_ahead(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: Gains,
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
    gains: Gains,
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
