"""`observer_fit`: the free parameters of a drive through the fixed-gain observer, robust against what the model lacks.

What the diagnosis stands on: a regime that the model misses must not pull the parameters of the others.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Estimate, Progress, require_x64, silent
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.least_squares import Innovations, equal_curvature, levenberg_marquardt
from frictionjax.estimation.loss import Cauchy
from frictionjax.estimation.parameters import at_a_bound
from frictionjax.estimation.problem import SLOW_BANDWIDTH, Problem, make_problem, misfits_of
from frictionjax.estimation.uncertainty import estimates, normal_equations, sandwich
from frictionjax.physics import Drive
from frictionjax.recordings import Recording

_STEPS = 5  # of Levenberg-Marquardt in a round; the first only looks around
_SHORTER = 2  # times that a round without any gain is tried again
_GRADUATION = (0.95, 0.8, 0.5)  # quantiles of the block powers that set the knee of the likelihood, in turn


def descend(
    problem: Problem,
    vector: Float[Array, " q"],
    *,
    graduate: bool = True,
    rounds: int = 6,
    tolerance: float = 2e-3,
) -> tuple[Float[Array, " q"], float, bool]:
    """Minimise the robust misfit by Levenberg-Marquardt.

    The knee of the Cauchy loss comes down from the upper quantiles of the block powers to the noise floor: with the
    knee at the floor from the start, a regime that misfits would be ignored.

    **Arguments:**

    - `problem`, `vector`: what to fit, and where to start.
    - `graduate`: whether to begin with wide knees.
    - `rounds`: at most this many rounds of a few steps with the knee at the floor.
    - `tolerance`: a round that takes less than this part off the misfit is the last (or less than 1e-4).

    **Returns:**

    Vector, misfit, and whether the last round still gained less than the tolerance (converged).
    """
    scored = np.asarray(problem.setting.batch.block_count) > 0
    power = problem.power(vector)
    best, best_value = vector, float(misfits_of(power[None], 1.0, problem.setting.batch)[0])
    unit = None
    if graduate:
        for quantile in _GRADUATION:
            level = max(float(np.quantile(np.asarray(power)[scored], quantile)), 1.0)
            if level < 1.2:
                continue  # the next knee would be the floor: that is what the rounds below do
            vector, unit = _round(problem, vector, level, unit)
            power = problem.power(vector)
            value = float(misfits_of(power[None], 1.0, problem.setting.batch)[0])
            if value < best_value:
                best, best_value = vector, value
    shorter = 0
    for _ in range(rounds):
        vector, unit = _round(problem, best, 1.0, unit)
        value = problem.mismatch(vector)
        gained = best_value - value
        if gained > 0:
            best, best_value = vector, value
        if gained < 1e-5 and shorter < _SHORTER:
            # Not one step was good: they went too far, through an event such as a break-away. Shorter units are more
            # damping.
            shorter, unit = shorter + 1, unit / 8.0
            continue
        if gained < max(1e-4, tolerance * best_value):
            return best, best_value, True
    return best, best_value, False


def _round(problem, vector, level, unit):
    """A few steps with the knee at the power `level`; the vector, and the units of the solver."""
    objective = Innovations(problem.layout, problem.setting, Cauchy(level))
    if unit is None:
        unit = equal_curvature(objective, vector)
    return levenberg_marquardt(objective, vector, unit, _STEPS).vector, unit


def require_positive(drive: Drive) -> None:
    """Raise the `ValueError` for a `drive` that does not start positive: zero would leave the fit where it began."""
    values = {"J": drive.J} | {p.name: getattr(drive.friction, p.name) for p in drive.friction.parameters}
    bad = [f"{name} = {float(value):g}" for name, value in values.items() if not float(value) > 0.0]
    if bad:
        raise ValueError(
            f"`drive` starts at {', '.join(bad)}; a fit needs positive starting values, however small."
        )


class ObserverFit(eqx.Module):
    """A fitted drive.

    **Attributes:**

    - `drive`: the fitted `Drive`.
    - `parameters`: label -> `Estimate` in physical units, standard errors by the clustered sandwich.
    - `covariance`: of the free vector (scaled and transformed), shape `(q, q)`.
    - `mismatch`: robust misfit per sample (0: noise).
    - `success`, `message`: whether the fit converged, and why it stopped or which bound it touches.
    - `problem`, `vector`: for those who go on from here.
    """

    drive: Drive
    parameters: dict[str, Estimate] = eqx.field(static=True)
    covariance: Float[np.ndarray, "q q"]
    mismatch: float
    success: bool
    message: str = eqx.field(static=True)
    problem: Problem
    vector: Float[Array, " q"]

    @property
    def stderr(self) -> dict[str, float]:
        """Label -> standard error in physical units."""
        return {name: estimate.stderr for name, estimate in self.parameters.items()}


def finish(
    problem: Problem, vector: Float[Array, " q"], converged: bool, units: dict[str, str]
) -> ObserverFit:
    """Standard errors and message for the end of a fit; `units` maps force, position, input to unit names."""
    final = problem.weighted(problem.power(vector), 1.0)
    hessian, gradients = (np.asarray(a) for a in normal_equations(final.layout, vector, final.setting))
    computable = bool(np.all(np.isfinite(hessian)) and np.all(np.isfinite(gradients)))
    covariance = (
        sandwich(hessian, gradients, np.asarray(final.setting.prior))
        if computable
        else np.full(hessian.shape, np.inf)
    )
    count = len(problem.layout)
    ends = at_a_bound(problem.layout, vector[:count], problem.setting.start[:count])
    message = "The fit converged." if converged else "The fit stopped while still improving slightly."
    if ends:
        message += f" At the end of its range: {', '.join(ends)}."
    if not computable:
        message += " The derivatives overflow at the solution: no standard errors can be given."
    return ObserverFit(
        drive=problem.drive(vector),
        parameters=estimates(problem.layout, vector, final.setting, covariance, units),
        covariance=covariance,
        mismatch=problem.mismatch(vector),
        success=converged and computable,
        message=message,
        problem=final,
        vector=vector,
    )


def observer_fit(
    drive: Drive | Sequence[Drive],
    recordings: Sequence[Recording],
    *,
    encoder_step: float | None = None,
    known_inertia: bool = False,
    scales: dict[str, float] | None = None,
    units: dict[str, str] | None = None,
    progress: Progress = silent,
) -> ObserverFit:
    """Fit inertia, LuGre parameters and the effects of `drive` to all `recordings` jointly.

    Prediction errors of a fixed-gain observer (robust to the drift of open-loop integration), block-wise Cauchy
    likelihood, Levenberg-Marquardt in scaled coordinates with forward-mode Jacobians; observer at 100 Hz first,
    then at 50 Hz.

    **Arguments:**

    - `drive`: structure and starting values, or several starts of one structure: the best goes on.
    - `recordings`: force-driven recordings.
    - `encoder_step`: quantum of the position sensor; None: the smallest step in the data.
    - `known_inertia`: keep J at the value of `drive`.
    - `scales`: sizes of the plant by name (see `frictionjax.diagnosis`); needed when effects are present.
    - `units`: names for `force`, `position` and `input`.
    - `progress`: called as the fit goes on.

    **Returns:**

    An `ObserverFit`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` when there is no recording, one is too short, a
    positive parameter starts at zero or below, or no start gives finite predictions.
    """
    require_x64()
    if not recordings:
        raise ValueError("`recordings` is empty; `observer_fit` needs at least one recording.")
    starts = (drive,) if isinstance(drive, Drive) else tuple(drive)
    batch = make_batch(tuple(recordings), encoder_step=encoder_step)
    for start in starts:
        require_positive(start)
    # One template for all starts: the vector carries the start, and nothing is compiled twice.
    problem, _ = make_problem(starts[0], batch, scales=scales, known_inertia=known_inertia)
    slow = problem.at_bandwidth(SLOW_BANDWIDTH)
    # A model with something missing has several minima, and which is the best is not to be seen after a few steps:
    # every start goes down with the fast observer, and the two that come lowest go on with the slow one.
    reached = []
    for index, start in enumerate(starts):
        progress(f"base fit: start {index + 1} of {len(starts)}", 0.7 * index / len(starts))
        _, vector = make_problem(start, batch, scales=scales, known_inertia=known_inertia)
        vector, value, _ = descend(problem, vector, rounds=4)
        reached.append((value, index, vector))
    progress("base fit: slow observer", 0.7)
    ends = []
    for value, index, vector in sorted(reached, key=lambda end: end[:2])[:2]:
        if np.isfinite(value):
            vector, value, converged = descend(slow, vector, graduate=False, rounds=8)
            ends.append((value, index, vector, converged))
    if not ends:
        raise ValueError(
            "No starting value gives finite predictions; check `drive`, and the units of the recordings and of "
            "the motor constant."
        )
    _, _, vector, converged = min(ends, key=lambda end: end[:2])
    progress("base fit: standard errors", 0.95)
    return finish(slow, vector, converged, units or {})
