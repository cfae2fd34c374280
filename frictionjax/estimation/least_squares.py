"""Weighted nonlinear least squares by optimistix: the one file that knows it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
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
_SMALL = 1e-4  # finite step, in scaled coordinates, that measures a unit


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


LANES = 5
"""Vectors that are simulated side by side. One number everywhere, so that each layout is compiled once."""


@eqx.filter_jit
def _lanes(layout, vectors, setting):
    return jax.vmap(lambda vector: predicted_errors(layout, vector, setting))(vectors)


def errors_of(
    layout: tuple[Free, ...], vectors: list[Float[Array, " q"]], setting: Setting
) -> Float[Array, "k r n"]:
    """Standardised innovations of any number of free vectors, shape `(k, r, n)`, five at a time."""
    found = []
    for first in range(0, len(vectors), LANES):
        some = vectors[first : first + LANES]
        padded = some + [some[-1]] * (LANES - len(some))
        found.append(_lanes(layout, jnp.stack(padded), setting)[: len(some)])
    return jnp.concatenate(found)


def equal_curvature(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> Float[Array, " q"]:
    """Units in which the Gauss-Newton matrix at `vector` has the same diagonal, shape `(q,)`.

    By finite steps: a tenth of a per cent is near enough for a unit, and nothing more has to be compiled. A starting
    deflection moves its own recording only, so one step serves all of them.
    """
    count = len(layout)
    steps = [jnp.zeros_like(vector).at[i].set(_SMALL) for i in range(count)]
    steps.append(jnp.zeros_like(vector).at[count:].set(_SMALL))
    e = errors_of(layout, [vector] + [vector + step for step in steps], setting)
    squares = jnp.sum(((e[1:] - e[:1]) / _SMALL) ** 2 * setting.weight[None], axis=2)
    curvature = jnp.concatenate([jnp.sum(squares[:count], axis=1), squares[count]])
    # A step that throws the trajectory says nothing of the curvature: such a coordinate keeps the unit of its prior.
    curvature = jnp.where(jnp.isfinite(curvature), curvature, 0.0)
    return _STRIDE / jnp.sqrt(curvature + setting.prior**2)


def levenberg_marquardt(
    layout: tuple[Free, ...],
    vector: Float[Array, " q"],
    setting: Setting,
    max_steps: int,
    unit: Float[Array, " q"] | None = None,
) -> tuple[Float[Array, " q"], Float[Array, ""]]:
    """At most `max_steps` Levenberg-Marquardt steps from `vector`, shape `(q,)`; returns the vector and the count.

    Weighted innovations and the weak prior are the residuals. A step that fails leaves the best vector so far.
    The solver damps every coordinate alike and starts at a damping of 1, so it is given coordinates in which the
    Gauss-Newton matrix has the same diagonal: without them, half a dozen rejected steps would still be undamped.
    `unit` is what `equal_curvature` gave (None: it is found here).
    """
    if unit is None:
        unit = equal_curvature(layout, vector, setting)
    return _solve(layout, vector, unit, setting, max_steps)


@eqx.filter_jit
def _solve(layout, vector, unit, setting, max_steps):
    # Normal equations: in these coordinates they are well scaled, and a tenth of the work of a QR of tall columns.
    solver = optx.LevenbergMarquardt(rtol=1e-3, atol=1e-2, linear_solver=lx.Normal(lx.Cholesky()))
    solution = optx.least_squares(
        lambda step, given: _residual(vector + unit * step, given, layout),
        solver,
        jnp.zeros_like(vector),
        args=setting,
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    return vector + unit * solution.value, solution.stats["num_steps"]
