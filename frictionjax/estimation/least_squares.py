"""Weighted nonlinear least squares by optimistix: the one file that knows it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.parameters import Free, unpack
from frictionjax.estimation.residuals import standardised
from frictionjax.physics import Drive
from frictionjax.simulation import Gains

# Coordinates are this many times longer than the standard deviation of a coordinate alone: the first damping is then a
# twenty-fifth of the curvature.
_STRIDE = 5.0


class Setting(eqx.Module):
    """Everything a residual needs beside the free vector.

    **Attributes:** `drive` (fixed parameters and structure), `batch`, `gains`, `weight` (shape `(r, n)`), `start`
    and `prior` (centre and inverse standard deviation of the weak prior, shape `(p + r,)`).
    """

    drive: Drive
    batch: Batch
    gains: Gains
    weight: Float[Array, "r n"]
    start: Float[Array, " q"]
    prior: Float[Array, " q"]


def predicted_errors(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> Float[Array, "r n"]:
    """Standardised innovations, shape `(r, n)`, for the free vector of shape `(q,)`, q = p + r: p parameters, then
    the starting deflection of the bristle in each recording (over Fs/sigma0)."""
    count = len(layout)
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
    return standardised(drive, vector[count:], setting.batch, setting.gains)


def error_jacobian(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> tuple[Float[Array, "r n"], Float[Array, "q r n"]]:
    """Standardised innovations and their forward-mode Jacobian, shape `(q, r, n)`.

    A starting deflection moves its own recording only, so one column serves all of them.
    """
    count, recordings = len(layout), vector.shape[0] - len(layout)
    basis = jnp.eye(count + 1, vector.shape[0]).at[count, count:].set(1.0)
    e, columns = jax.vmap(
        lambda tangent: jax.jvp(lambda q: predicted_errors(layout, q, setting), (vector,), (tangent,)),
        out_axes=(None, 0),
    )(basis)
    own = jnp.eye(recordings)[:, :, None] * columns[count][None]
    return e, jnp.concatenate([columns[:count], own])


jacobian_of = eqx.filter_jit(error_jacobian)
"""`error_jacobian`, compiled once for each layout and shared by all who need it outside the solver."""


def _stack(e, prior):
    return jnp.concatenate([e.ravel(), prior])


@eqx.filter_custom_jvp
def _residual(point, given, layout):
    e = predicted_errors(layout, point, given)
    return _stack(e * jnp.sqrt(given.weight), (point - given.start) * given.prior)


@_residual.def_jvp
def _residual_jvp(primals, tangents):
    # The Jacobian is made once, dense, in forward mode. Left to itself `linearize` would store the whole scan and
    # walk through it again for every column: four times slower on long records.
    point, given, layout = primals
    e, columns = error_jacobian(layout, point, given)
    root = jnp.sqrt(given.weight)
    jacobian = jnp.concatenate(
        [(columns * root[None]).reshape(columns.shape[0], -1).T, jnp.diag(given.prior)]
    )
    return _stack(e * root, (point - given.start) * given.prior), jacobian @ tangents[0]


@eqx.filter_jit
def _equal_curvature(columns, weight, prior):
    return _STRIDE / jnp.sqrt(jnp.sum(columns**2 * weight[None], axis=(1, 2)) + prior**2)


def levenberg_marquardt(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting, max_steps: int
) -> tuple[Float[Array, " q"], Float[Array, ""]]:
    """At most `max_steps` Levenberg-Marquardt steps from `vector`, shape `(q,)`; returns the vector and the count.

    Weighted innovations and the weak prior are the residuals. A step that fails leaves the best vector so far.
    The solver damps every coordinate alike and starts at a damping of 1, so it is given coordinates in which the
    Gauss-Newton matrix has the same diagonal: without them, half a dozen rejected steps would still be undamped.
    """
    _, columns = jacobian_of(layout, vector, setting)
    return _solve(
        layout, vector, _equal_curvature(columns, setting.weight, setting.prior), setting, max_steps
    )


@eqx.filter_jit
def _solve(layout, vector, unit, setting, max_steps):
    solution = optx.least_squares(
        lambda step, given: _residual(vector + unit * step, given, layout),
        optx.LevenbergMarquardt(rtol=1e-3, atol=1e-2),
        jnp.zeros_like(vector),
        args=setting,
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    return vector + unit * solution.value, solution.stats["num_steps"]
