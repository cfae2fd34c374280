"""Least squares on one problem from one start: as `fit` goes, its solver alone, and scipy's."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree
from scipy.optimize import least_squares

from benchmarks.nist.models import MODELS, Model
from benchmarks.nist.problems import Problem
from frictionjax.estimation.descent.levenberg_marquardt import Descent, equal_curvature, levenberg_marquardt
from frictionjax.estimation.descent.refine import AbstractRounds, OneFit, at_start, refine
from frictionjax.estimation.descent.round import NEAR_TOLERANCE, NEAR_UNITS, FitState, RoundProgress, judged
from frictionjax.estimation.descent.stepper import Ending
from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic

MOST_EVALUATIONS = 2000
"""Of a solver alone, and of scipy's."""
_FAR_STEPS = 60  # of each of the two descents that come first, as in a fit to imposed motions
_ROUND_STEPS = 5  # of a round, as in a fit
_TOLERANCE = 1e-10  # of a unit: the solver alone goes on until rounding errors stop it
_LONGER, _SHORTER = (
    NEAR_UNITS,
    4.0,
)  # units after a descent that came to rest, and after one whose last steps all failed
_STILL = 1e-12  # relative: a descent that moves no parameter by more has not moved
_LEAST = 1e-15  # tolerances of scipy's: next to the distance between two numbers


class Ended(NamedTuple):
    """Where a descent ended: the parameters, shape `(p,)`; the number of `evaluations`, the first at the start; and
    `why`."""

    parameters: Float[np.ndarray, " p"]
    evaluations: int
    why: str


class Residuals(AbstractObjective):
    """Residuals of a `model` over one standard deviation `std`: what a fit without recordings would bring down.

    `x`, `y` as in `Problem`. The last two say what `refine` asks of the posterior of a fit.
    """

    model: Model = eqx.field(static=True)
    x: Float[Array, "k n"]
    y: Float[Array, " n"]
    std: Float[Array, ""]
    evidence: tuple[()] = ()
    has_positions: bool = eqx.field(static=True, default=False)

    def errors(self, vector: Float[Array, " p"]) -> Float[Array, " n"]:
        """The residuals at the parameters `vector`."""
        return (self.model(vector, self.x) - self.y) / self.std

    def quadratic(self, vector: Float[Array, " p"]) -> Quadratic:
        """Half the sum of squares near `vector`."""
        e, slope = self.errors(vector), jax.jacfwd(self.errors)(vector)
        return Quadratic(0.5 * e @ e, slope.T @ e, slope.T @ slope)


def residuals_of(problem: Problem) -> Residuals:
    """The residuals of a `problem` in its own unit."""
    return Residuals(MODELS[problem.name], jnp.asarray(problem.x), jnp.asarray(problem.y), jnp.asarray(1.0))


@eqx.filter_jit
def _errors(objective: Residuals, b: Float[Array, " p"]) -> Float[Array, " n"]:
    return objective.errors(b)


@eqx.filter_jit
def _slopes(objective: Residuals, b: Float[Array, " p"]) -> Float[Array, "n p"]:
    return jax.jacfwd(objective.errors)(b)


def _likeliest(objective: Residuals, b: Float[np.ndarray, " p"]) -> Residuals:
    """The same with the likeliest standard deviation at the parameters `b`."""
    root = np.sqrt(np.mean(np.square(np.asarray(_errors(objective, b)))))
    return eqx.tree_at(lambda r: r.std, objective, objective.std * root)


class _Rounds(AbstractRounds):
    """Rounds of one fit of `Residuals`, which are all that it has; `taken`: evaluations of each so far."""

    known: Bool[np.ndarray, " r"]
    substeps: int = eqx.field(static=True)
    taken: list[int]

    def round(self, state: FitState, ratios: Float[np.ndarray, "r k"] | None) -> FitState:
        """The likeliest noise, then a few steps."""
        objective = _likeliest(state.posterior, state.vector)
        unit = NEAR_UNITS * equal_curvature(objective, state.vector) if state.unit is None else state.unit
        end = levenberg_marquardt(objective, state.vector, unit, _ROUND_STEPS, tolerance=NEAR_TOLERANCE)
        self.taken.append(int(end.steps))
        cost = end.cost + objective.y.size * np.log(objective.std)
        return FitState(objective, end.vector, None, NEAR_UNITS * end.unit, cost, end.ending)

    def started(self, state: FitState) -> RoundProgress:
        """The progress before any round."""
        return OneFit(self.known, self.substeps).started(state)

    def judged(
        self, progress: RoundProgress, before: FitState, after: FitState
    ) -> tuple[RoundProgress, Bool[np.ndarray, ""], Bool[np.ndarray, ""]]:
        """The stopping rule of a fit."""
        return judged(progress, before, after)

    def coulomb(self, state: FitState) -> Float[np.ndarray, ""]:
        """None: there is no friction here."""
        return np.zeros(())

    def where(self, chosen: Bool[np.ndarray, ""], this: PyTree, other: PyTree) -> PyTree:
        """`this` where `chosen`, else the `other`."""
        return this if bool(chosen) else other


def as_fit(problem: Problem, start: Float[np.ndarray, " p"]) -> Ended:
    """The way of `fit` from `start` to where its own rule ends it: two descents of many steps, then noise and
    parameters in turn."""
    objective, vector, taken = residuals_of(problem), start, []
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(2):
            objective = _likeliest(objective, vector)
            unit = equal_curvature(objective, vector)
            end = levenberg_marquardt(objective, vector, unit, _FAR_STEPS, tolerance=NEAR_TOLERANCE)
            vector = end.vector
            taken.append(int(end.steps))
        refined = refine(_Rounds(np.zeros(0, dtype=bool), 1, taken), at_start(objective, vector))
    why = "converged" if refined.converged else refined.ending.name.lower()
    return Ended(np.asarray(refined.vector), sum(taken), why)


def alone(problem: Problem, start: Float[np.ndarray, " p"]) -> Ended:
    """The solver of `fit` from `start`, again from where it ended until two descents in a row move nothing."""
    objective, vector, evaluations, longer, still = residuals_of(problem), start, 0, 1.0, 0
    ending = Ending.STEPS
    with np.errstate(over="ignore", invalid="ignore"):
        while still < 2 and evaluations < MOST_EVALUATIONS and ending is not Ending.NOT_FINITE:
            objective = _likeliest(objective, vector)
            unit = longer * equal_curvature(objective, vector)
            most = MOST_EVALUATIONS - evaluations
            end: Descent = levenberg_marquardt(objective, vector, unit, most, tolerance=_TOLERANCE)
            ending, evaluations = list(Ending)[int(end.ending)], evaluations + int(end.steps)
            moved = np.any(np.abs(end.vector - vector) > _STILL * np.abs(end.vector))
            still = 0 if moved else still + 1
            longer = longer * _LONGER if ending is Ending.AT_REST else longer / _SHORTER
            vector = end.vector
    return Ended(np.asarray(vector), evaluations, ending.name.lower())


def by_scipy(problem: Problem, start: Float[np.ndarray, " p"], method: str) -> Ended:
    """`scipy.optimize.least_squares` from `start` by `method`, with the same exact derivatives, coordinates scaled by
    the Jacobian, and tolerances that only rounding errors meet."""
    objective = residuals_of(problem)
    with np.errstate(over="ignore", invalid="ignore"):
        found = least_squares(
            lambda b: np.asarray(_errors(objective, b)),
            start,
            jac=lambda b: np.asarray(_slopes(objective, b)),
            method=method,
            x_scale="jac",
            ftol=_LEAST,
            xtol=_LEAST,
            gtol=_LEAST,
            max_nfev=MOST_EVALUATIONS,
        )
    return Ended(found.x, found.nfev, found.message)
