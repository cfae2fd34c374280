"""Weighted nonlinear least squares: step by step by NumPy, or, inside transformations, in a compiled loop of optimistix
(this is the one file that knows it). Both ask the same `Stepper` for steps, acceptance, damping and end."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from frictionjax.core.arrays import Numbers, known, numpy_or_jax
from frictionjax.estimation.descent.stepper import AbstractPlace, Course, Ending, Stepper, is_small_change
from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic

STRIDE = 5.0
"""Units are this many times the standard deviation of a coordinate alone: the first damping is then a twenty-fifth of
the curvature."""
# A fit damps in coordinates that are scaled once, and eases its damping only where the quadratic model holds: by the
# rule of a diagnosis one from a bad start stopped two nats above its minimum.
OF_A_FIT = Stepper(
    damping=1.0,
    scaled=False,
    easing=3.5,
    raising=4.0,
    enough=0.01,
    good=0.99,
    longest=float("inf"),
    in_a_row=1,
)


def small_residuals(near: Quadratic) -> tuple[Float[Numbers, " q1"], Float[Numbers, "q1 q"]]:
    """Residuals f, shape `(q + 1,)`, and a Jacobian A, shape `(q + 1, q)`, of the cost `near` a vector: f'f twice the
    cost, A'f the gradient, A'A the matrix.

    A least-squares solver uses nothing of a problem but these products, so a dozen residuals may stand for 100 000, and
    for a robust loss too: nothing that is as long as a recording has to be stored, stacked or factored.
    """
    xp, (near,) = known(near)
    factor, along = (_triangular if xp is np else _triangular_traced)(near.hessian, near.gradient)
    # The root is real: g'H^-1 g is at most the weighted squares, and rho is at least b rho', being concave.
    last = xp.sqrt(xp.maximum(2.0 * near.cost - along @ along, 0.0))
    return xp.concatenate([along, last[None]]), xp.concatenate([factor.T, xp.zeros_like(near.gradient)[None]])


def _triangular_traced(
    hessian: Float[Numbers, "q q"], gradient: Float[Numbers, " q"]
) -> tuple[Float[Numbers, "q q"], Float[Numbers, " q"]]:
    """The triangular root L of the `hessian` LL', and L^-1 times the `gradient`; not finite where there is no root."""
    factor = jnp.linalg.cholesky(hessian)
    return factor, jax.scipy.linalg.solve_triangular(factor, gradient, lower=True)


def _triangular(
    hessian: Float[np.ndarray, "q q"], gradient: Float[np.ndarray, " q"]
) -> tuple[Float[np.ndarray, "q q"], Float[np.ndarray, " q"]]:
    """`_triangular_traced` by NumPy."""
    if np.all(np.isfinite(hessian)) and np.all(np.isfinite(gradient)):
        try:
            factor = np.linalg.cholesky(hessian)
            along: Any = scipy.linalg.solve_triangular(factor, gradient, lower=True)
            return factor, along
        except np.linalg.LinAlgError:  # not positive definite
            pass
    return np.full(hessian.shape, np.nan), np.full(gradient.shape, np.nan)


@eqx.filter_custom_jvp
def _residual(point: Float[Numbers, " q"], objective: AbstractObjective) -> Float[Numbers, " q1"]:
    return small_residuals(objective.quadratic(point))[0]


@_residual.def_jvp
def _residual_jvp(
    primals: tuple[Float[Numbers, " q"], AbstractObjective], tangents: tuple[Float[Numbers, " q"], Any]
) -> tuple[Float[Numbers, " q1"], Float[Numbers, " q1"]]:
    # The Jacobian is made once, dense, in forward mode. Left to itself `linearize` would store the whole scan and
    # walk through it again for every column: four times slower on long records.
    point, objective = primals
    f, jacobian = small_residuals(objective.quadratic(point))
    return f, jacobian @ tangents[0]


class Descent(NamedTuple):
    """Where a descent ended: `vector`, shape `(q,)`, its `cost`, the number of `steps`, the units of equal curvature
    there, `unit`, shape `(q,)`, as those of `equal_curvature`, and the number of the `ending` (`Ending.number`)."""

    vector: Float[Numbers, " q"]
    cost: Float[Numbers, ""]
    steps: Int[Numbers, ""]
    unit: Float[Numbers, " q"]
    ending: Int[Numbers, ""]


def equal_curvature(objective: AbstractObjective, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
    """Units in which the Gauss-Newton matrix of `objective` at `vector` has the same diagonal, shape `(q,)`."""
    xp = numpy_or_jax(objective, vector)
    near = objective.near(vector) if xp is np else objective.quadratic(vector)
    # A run that overflows has no curvature: its coordinates keep their own unit.
    return _units(xp.diag(near.hessian), 1.0)


def _units(curvature: Float[Numbers, " q"], unit: Float[Numbers, " q"] | float) -> Float[Numbers, " q"]:
    """Times the `unit`, lengths of equal `curvature`; the unit itself where there is none."""
    xp = numpy_or_jax(curvature)
    curved = xp.where(curvature > 0.0, curvature, 1.0)
    return xp.where(curvature > 0.0, unit * STRIDE / xp.sqrt(curved), unit)


@functools.cache
def _solver(stepper: Stepper, tolerance: float) -> Any:
    """The solver of optimistix that takes the steps of `stepper`.

    Optimistix has the loop and its results; which step comes next, and which is the last, is a *descent* and a *search*
    there. Classes inside a function: the library loads slowly, and a diagnosis has a loop of its own.
    """
    import optimistix as optx

    class Steps(optx.AbstractDescent):
        """Steps of `stepper`; for the search, the size of a step is the inverse of its damping."""

        def init(
            self, y: Float[Numbers, " q"], f_info_struct: Any
        ) -> tuple[Float[Numbers, "q q"], Float[Numbers, " q"]]:
            return jnp.zeros((y.size, y.size)), jnp.zeros_like(y)

        def query(
            self, y: Float[Numbers, " q"], f_info: Any, state: Any
        ) -> tuple[Float[Numbers, "q q"], Float[Numbers, " q"]]:
            jacobian = f_info.jac.as_matrix()
            return jacobian.T @ jacobian, jacobian.T @ f_info.residual

        def step(
            self, step_size: Float[Numbers, ""], state: tuple[Float[Numbers, "q q"], Float[Numbers, " q"]]
        ) -> tuple[Float[Numbers, " q"], Any]:
            step = jnp.asarray(stepper.step(*state, 1.0 / step_size))
            sound = jnp.all(jnp.isfinite(step))
            return step, optx.RESULTS.where(sound, optx.RESULTS.successful, optx.RESULTS.nonfinite)

    class StepSearch(optx.AbstractSearch):
        """What `stepper` makes of each step."""

        def init(self, y: Float[Numbers, " q"], f_info_struct: Any) -> Course:
            return jax.tree.map(jnp.asarray, stepper.first)

        def step(
            self,
            first_step: Bool[Numbers, ""],
            y: Float[Numbers, " q"],
            y_eval: Float[Numbers, " q"],
            f_info: Any,
            f_eval_info: Any,
            state: Course,
        ) -> tuple[Float[Numbers, ""], Bool[Numbers, ""], Any, Course]:
            step, residual = y_eval - y, f_info.residual
            after = f_info.jac.mv(step) + residual
            predicted = 0.5 * (after @ after - residual @ residual)
            change = f_eval_info.as_min() - f_info.as_min()
            other = f_eval_info.residual
            small = is_small_change(y_eval, step, tolerance) & is_small_change(
                other, other - residual, tolerance
            )
            course = stepper.after(state, change, predicted, small)
            # The first one only evaluates the start.
            course = jax.tree.map(lambda old, new: jnp.where(first_step, old, new), state, course)
            return 1.0 / course.damping, course.accepted, optx.RESULTS.successful, course

    class Solver(optx.AbstractGaussNewton):
        """Least squares by these steps; the tolerances are not asked."""

        rtol: float = 1.0
        atol: float = 1.0
        norm: Callable = optx.max_norm
        descent: Steps = Steps()
        search: StepSearch = StepSearch()
        verbose: Callable = _silent

        def terminate(
            self, fn: Any, y: Any, args: Any, options: Any, state: Any, tags: Any
        ) -> tuple[Bool[Numbers, ""], Any]:
            return state.search_state.ended, state.result

    return Solver()


def _silent(**_: object) -> None:
    """No output: optimistix reports every step."""


def levenberg_marquardt(
    objective: AbstractObjective,
    vector: Float[Numbers, " q"],
    unit: Float[Numbers, " q"],
    max_steps: int,
    *,
    stepper: Stepper = OF_A_FIT,
    tolerance: float = 1e-2,
) -> Descent:
    """At most `max_steps` Levenberg-Marquardt steps from `vector`, shape `(q,)`.

    A step that fails leaves the best vector so far; one shorter than `tolerance` units that also changes the residuals
    by no more is the last.

    **Arguments:**

    - `objective`: what to bring down.
    - `vector`: where to start, shape `(q,)`.
    - `unit`: of the coordinates, shape `(q,)`: those of `equal_curvature`, or longer where less damping is needed.
    - `max_steps`: evaluations, the first of them at `vector` itself.
    - `stepper`: of the steps.
    - `tolerance`: of the last step, in units.
    """
    xp, (vector, unit) = known(vector, unit)
    if xp is np and numpy_or_jax(objective) is np:
        return _step_by_step(_LeastSquaresProblem(objective, vector, unit, tolerance), max_steps, stepper)
    import optimistix as optx

    solution = optx.least_squares(
        lambda step, given: _residual(vector + unit * step, given),
        _solver(stepper, tolerance),
        jnp.zeros_like(vector),
        args=objective,
        options={"jac": "fwd"},
        max_steps=max_steps,
        throw=False,
    )
    lost = solution.result == optx.RESULTS.nonfinite
    jacobian = solution.state.f_info.jac.as_matrix()
    curvature = jnp.sum(jacobian * jacobian, axis=0)
    return Descent(
        vector + unit * solution.value,
        solution.state.f_info.as_min(),
        solution.stats["num_steps"],
        _units(curvature, unit),
        jnp.where(lost, Ending.NOT_FINITE.number, solution.state.search_state.ending),
    )


class _LeastSquaresPlace(AbstractPlace):
    """A `place`, in units, on the way down an `objective`, with the residuals that stand for its cost there, and their
    `slope` by the place."""

    problem: "_LeastSquaresProblem"
    place: Float[np.ndarray, " q"]
    residual: Float[np.ndarray, " q1"]
    slope: Float[np.ndarray, "q1 q"]

    @property
    def cost(self) -> float:
        """At the place."""
        return float(0.5 * self.residual @ self.residual)

    @property
    def gradient(self) -> Float[np.ndarray, " q"]:
        """Of the cost."""
        return self.slope.T @ self.residual

    @property
    def hessian(self) -> Float[np.ndarray, "q q"]:
        """Of the cost, by Gauss and Newton."""
        return self.slope.T @ self.slope

    @property
    def longest(self) -> None:
        """As the stepper has it."""
        return None

    def moved(self, step: Float[np.ndarray, " q"]) -> "_LeastSquaresPlace":
        """The place a `step` further."""
        return self.problem.at(self.place + step)

    def is_near(self, there: "_LeastSquaresPlace") -> bool:
        """Whether neither place nor residuals change by more than the tolerance."""
        pairs = ((there.place, self.place), (there.residual, self.residual))
        return all(bool(is_small_change(new, new - old, self.problem.tolerance)) for new, old in pairs)

    def is_minimum(self) -> bool:
        """Left to the rounds of a fit, which try once more with more damping."""
        return False


class _LeastSquaresProblem(NamedTuple):
    """An `objective` from `vector` on, in these units, and the `tolerance` of the last step."""

    objective: AbstractObjective
    vector: Float[np.ndarray, " q"]
    unit: Float[np.ndarray, " q"]
    tolerance: float

    def at(self, place: Float[np.ndarray, " q"]) -> _LeastSquaresPlace:
        """What is evaluated at a `place`."""
        f, slope = small_residuals(self.objective.near(self.vector + self.unit * place))
        return _LeastSquaresPlace(self, place, f, slope * self.unit)


def _step_by_step(problem: _LeastSquaresProblem, max_steps: int, stepper: Stepper) -> Descent:
    """`levenberg_marquardt` outside of transformations: nothing but the objective is compiled."""
    first = problem.at(np.zeros_like(problem.vector))
    end, ending, tried = stepper.descend(first, max_steps - 1)
    return Descent(
        problem.vector + problem.unit * end.place,
        np.asarray(end.cost),
        np.asarray(tried + 1),
        _units(np.diag(end.hessian), problem.unit),
        np.asarray(ending.number),
    )
