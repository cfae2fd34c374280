"""Weighted nonlinear least squares by optimistix: the one file that knows it."""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from frictionjax.estimation.batch import AbstractBatch
from frictionjax.estimation.loss import AbstractLoss
from frictionjax.estimation.parameters import Free, unpack
from frictionjax.estimation.residuals import standardised
from frictionjax.physics import Drive
from frictionjax.simulation import Gains

# Coordinates are this many times longer than the standard deviation of a coordinate alone: the first damping is then a
# twenty-fifth of the curvature.
STRIDE = 5.0


class Setting(eqx.Module):
    """Everything a residual needs beside the free vector.

    **Attributes:** `drive` (fixed parameters and structure), `batch`, `gains`, `weight` (1 where a fit of the
    diagnosis sees the sample, else 0, shape `(r, n)`), `start` and `prior` (centre and inverse standard deviation of
    the weak prior, shape `(p + r,)`).
    """

    drive: Drive
    batch: AbstractBatch
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


def drives_at(layout: tuple[Free, ...], vectors: Float[Array, "k q"], setting: Setting) -> Drive:
    """The `Drive` of each of the free `vectors`: leaves of shape `(k, ...)`; inside compiled functions."""
    count = len(layout)
    return jax.vmap(lambda own: unpack(layout, setting.drive, own, setting.start[:count]))(vectors[:, :count])


def compact_jacobian(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting
) -> tuple[Float[Array, "r n"], Float[Array, "p1 r n"]]:
    """Standardised innovations and their forward-mode Jacobian by the p parameters and, last, of each recording by its
    own starting deflection, shape `(p + 1, r, n)`: it moves no other, so one column serves all of them."""
    count = len(layout)
    basis = jnp.eye(count + 1, vector.shape[0]).at[count, count:].set(1.0)
    return jax.vmap(
        lambda tangent: jax.jvp(lambda q: predicted_errors(layout, q, setting), (vector,), (tangent,)),
        out_axes=(None, 0),
    )(basis)


def all_columns(compact: Float[Array, "p1 r n"]) -> Float[Array, "q r n"]:
    """The Jacobian by all q = p + r free coordinates, of a `compact_jacobian`."""
    own = jnp.eye(compact.shape[1])[:, :, None] * compact[-1][None]
    return jnp.concatenate([compact[:-1], own])


class Quadratic(eqx.Module):
    """A cost near one vector: its value, its `gradient`, shape `(q,)`, and a Gauss-Newton `hessian`, shape `(q, q)`."""

    cost: Float[Array, ""]
    gradient: Float[Array, " q"]
    hessian: Float[Array, "q q"]

    def __add__(self, other: "Quadratic") -> "Quadratic":
        """Both costs together."""
        return Quadratic(self.cost + other.cost, self.gradient + other.gradient, self.hessian + other.hessian)


def quadratic_of(
    e: Float[Array, "b n"],
    columns: Float[Array, "q b n"],
    count: Float[Array, " b"],
    loss: AbstractLoss,
    share: Float[Array, " b"],
) -> Quadratic:
    """Cost 1/2 sum of `count` rho(mean square) over blocks of standardised errors, with exact gradient.

    The matrix is that of re-weighted least squares: the bend of a robust loss is left out. With it steps are longer,
    and from starts 30 % off they ran into minima at the ends of the range.

    **Arguments:**

    - `e`: errors over their standard deviations, 0 where not scored, shape `(b, n)`: b blocks.
    - `columns`: their derivatives, shape `(q, b, n)`.
    - `count`: scored samples in each block, shape `(b,)`.
    - `loss`: an `AbstractLoss`.
    - `share`: how much each block's cost counts, shape `(b,)`.
    """
    size = jnp.maximum(count, 1.0)
    power = jnp.sum(e * e, axis=1) / size
    weight = loss.weight(power) * share
    root = jnp.sqrt(weight)[:, None]
    tall = (columns * root[None]).reshape(columns.shape[0], -1)
    gradient = tall @ (e * root).ravel()
    return Quadratic(0.5 * jnp.sum(share * count * loss.cost(power)), gradient, tall @ tall.T)


class AbstractObjective(eqx.Module):
    """A cost that `levenberg_marquardt` can bring down."""

    @abstractmethod
    def quadratic(self, vector: Float[Array, " q"]) -> Quadratic:
        """The cost near `vector`, shape `(q,)`."""


def small_residuals(near: Quadratic) -> tuple[Float[Array, " q1"], Float[Array, "q1 q"]]:
    """Residuals f, shape `(q + 1,)`, and a Jacobian A, shape `(q + 1, q)`, of the cost `near` a vector: f'f twice the
    cost, A'f the gradient, A'A the matrix.

    A least-squares solver sees no more of a problem than these products, so a dozen numbers may stand for 100 000, and
    for a robust loss too: nothing that is as long as a recording has to be stored, stacked or factored.
    """
    factor = jnp.linalg.cholesky(near.hessian)
    along = jax.scipy.linalg.solve_triangular(factor, near.gradient, lower=True)
    # The root is real: g'H^-1 g is at most the weighted squares, and rho is at least b rho', being concave.
    last = jnp.sqrt(jnp.maximum(2.0 * near.cost - along @ along, 0.0))
    return jnp.concatenate([along, last[None]]), jnp.concatenate(
        [factor.T, jnp.zeros_like(near.gradient)[None]]
    )


@eqx.filter_custom_jvp
def _residual(point, objective):
    return small_residuals(objective.quadratic(point))[0]


@_residual.def_jvp
def _residual_jvp(primals, tangents):
    # The Jacobian is made once, dense, in forward mode. Left to itself `linearize` would store the whole scan and
    # walk through it again for every column: four times slower on long records.
    point, objective = primals
    f, jacobian = small_residuals(objective.quadratic(point))
    return f, jacobian @ tangents[0]


class Descent(NamedTuple):
    """Where a descent ended: `vector`, shape `(q,)`, its `cost`, the number of `steps`, and the units of equal
    curvature there, `unit`, shape `(q,)`, as those of `equal_curvature`."""

    vector: Float[Array, " q"]
    cost: Float[Array, ""]
    steps: Int[Array, ""]
    unit: Float[Array, " q"]


@eqx.filter_jit
def equal_curvature(objective: AbstractObjective, vector: Float[Array, " q"]) -> Float[Array, " q"]:
    """Units in which the Gauss-Newton matrix of `objective` at `vector` has the same diagonal, shape `(q,)`."""
    curvature = jnp.diag(objective.quadratic(vector).hessian)
    # A run that overflows says nothing of the curvature: its coordinates keep their own unit.
    return jnp.where(curvature > 0.0, STRIDE / jnp.sqrt(jnp.where(curvature > 0.0, curvature, 1.0)), 1.0)


@eqx.filter_jit
def levenberg_marquardt(
    objective: AbstractObjective,
    vector: Float[Array, " q"],
    unit: Float[Array, " q"],
    max_steps: int,
    *,
    tolerance: float = 1e-2,
) -> Descent:
    """At most `max_steps` Levenberg-Marquardt steps of optimistix from `vector`, shape `(q,)`.

    A step that fails leaves the best vector so far; one shorter than `tolerance` units is the last. The solver damps
    every coordinate alike and starts at a damping of 1, so it works in coordinates `unit` in which the matrix of
    `objective` has the same diagonal (`equal_curvature`): without them, half a dozen rejected steps would still be
    undamped.
    """
    # Normal equations: in these coordinates they are well scaled.
    import lineax as lx  # both load slowly, and a diagnosis has a descent of its own
    import optimistix as optx

    solver = optx.LevenbergMarquardt(rtol=1e-3, atol=tolerance, linear_solver=lx.Normal(lx.Cholesky()))
    solution = optx.least_squares(
        lambda step, given: _residual(vector + unit * step, given),
        solver,
        jnp.zeros_like(vector),
        args=objective,
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    jacobian = solution.state.f_info.jac.as_matrix()
    curvature = jnp.sum(jacobian * jacobian, axis=0)
    return Descent(
        vector + unit * solution.value,
        solution.state.f_info.as_min(),
        solution.stats["num_steps"],
        jnp.where(
            curvature > 0.0, unit * STRIDE / jnp.sqrt(jnp.where(curvature > 0.0, curvature, 1.0)), unit
        ),
    )
