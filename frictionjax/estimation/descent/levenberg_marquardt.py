"""Weighted nonlinear least squares by optimistix: the one file that knows it."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic

# Coordinates are this many times longer than the standard deviation of a coordinate alone: the first damping is then a
# twenty-fifth of the curvature.
STRIDE = 5.0


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
