"""The base model fitted to a case: LuGre and inertia, from every starting value, by a robust loss."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Bool

from frictionjax.core import Estimate, Progress
from frictionjax.diagnosis.base_model.likeliest import likeliest_parameters, observed_as_asked
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.pace import at_pace, is_coarse, pace_of
from frictionjax.diagnosis.evidence.step_length import steps_needed, with_steps
from frictionjax.diagnosis.intake.starting_point import StartingPoint
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.robust import RobustFit, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import robust_posterior
from frictionjax.estimation.parameters import at_a_bound
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.uncertainty import estimates, uncertainty_at
from frictionjax.physics import Drive

_CHAOTIC = "Backlash makes the motion chaotic. Errors are computed from predictable intervals only and are too small."


def base_of(
    starting: StartingPoint,
    executor: Executor,
    progress: Progress,
    *,
    rule: Rule = Rule(),
) -> Model:
    """The base model fitted to the recordings of `starting` that are not held out, in parallel by the `executor`, with
    `progress`; what the user knows of it stays, and the `rule` says how many integration steps are enough."""
    return fit_base(
        starting.start.drives,
        starting.batch,
        starting.held_out,
        executor,
        progress,
        fixed=starting.own.fixed,
        rule=rule,
    )


def fit_base(
    starts: Sequence[Drive],
    batch: AbstractBatch,
    held_out: Bool[np.ndarray, " r"],
    executor: Executor,
    progress: Progress,
    *,
    fixed: frozenset[str] = frozenset(),
    like: Model | None = None,
    rule: Rule = Rule(),
) -> Model:
    """Fit inertia, LuGre parameters and effects of the `starts` to the recordings of `batch` that are not `held_out`,
    robustly; but for the parameters whose paths are `fixed`.

    Where physics is missing the loss has several minima, and the misfits of the starting values do not show which of
    them leads to the lowest: each of the `starts` is fitted with the fast observer, and the two with the lowest misfit
    with the slow one. The better of these is fitted again with as many integration steps a sample as it needs
    (`steps_needed`), which the model keeps. How slow the observers may be depends on friction (`pace_of`): on that of
    the first start, and, where a sensor is coarse, once more on that of the `likeliest` parameters.

    **Raises:** `ValueError` when no start gives finite predictions.
    """
    progress(f"base fit: {len(starts)} starting values", 0.0)
    # Each has a range of its own: starts may lie orders of magnitude apart.
    scales = plant_scales(starts[0], batch)
    pace = (
        pace_of(starts[0], batch, held_out, rule=rule) if like is None else like.posterior.recordings.pace  # type: ignore[attr-defined]
    )
    posed = [
        robust_posterior(start, batch, held_out, scales=scales, fixed=fixed, pace=pace) for start in starts
    ]
    fast = list(executor.map(lambda pair: descend(*pair, steps=15, tolerance=0.02), posed))
    order = sorted(range(len(starts)), key=lambda number: fast[number].misfit)
    progress("base fit: slow observer", 0.6)
    best = [number for number in order[:2] if np.isfinite(fast[number].misfit)]
    schedule = None if like is None else like.posterior.recordings.schedule  # type: ignore[attr-defined]
    slow = [at_pace(posed[number][0], pace, schedule) for number in best]
    refined = list(
        executor.map(lambda one, number: descend(one, fast[number].vector, graduate=False), slow, best)
    )
    if not refined:
        raise ValueError(
            "No starting value gives finite predictions; check `drive`, and the units of the recordings and of "
            "the motor constant."
        )
    posterior, fitted = min(zip(slow, refined, strict=True), key=lambda pair: pair[1].misfit)
    if is_coarse(posterior) and like is None:
        progress("base fit: likeliest parameters", 0.7)
        posterior, fitted = _at_its_own_pace(posterior, fitted, held_out, rule)
    steps = (
        steps_needed(posterior, fitted.vector, rule=rule) if like is None else like.posterior.batch.substeps
    )
    if steps > 1:
        progress(f"base fit: {steps} integration steps a sample", 0.8)
        posterior = with_steps(posterior, steps)
        fitted = descend(posterior, fitted.vector, graduate=False)
    return Model(posterior, fitted, judge(posterior, fitted))


def _at_its_own_pace(
    posterior: Posterior, fitted: RobustFit, held_out: Bool[np.ndarray, " r"], rule: Rule
) -> tuple[Posterior, RobustFit]:
    """The base model with the observers that it asks for, by the `rule`, converged from its likeliest parameters and
    from where it was `fitted`: the better end."""
    paced, there = observed_as_asked(posterior, fitted.vector, held_out, rule=rule)
    ends = [descend(paced, vector, graduate=False) for vector in (there, fitted.vector)]
    return paced, min(ends, key=lambda end: end.misfit)


def parameters_of(model: Model, units: dict[str, str], *, lacking: bool = False) -> dict[str, Estimate]:
    """Physical values of the free parameters of `model` with their standard errors.

    They are the likeliest ones, as of `fit`, with its errors: innovations of an observer whose gains are not those of
    the Kalman filter are correlated, and what they hold is not the sum of what each one holds. Where the motion is
    imposed or chaotic, and of a model that is `lacking` an effect that was found, which biases its parameters by far
    more, they are those of the descent.

    **Arguments:**

    - `model`: the fitted model.
    - `units`: maps force, position, input to unit names.
    - `lacking`: whether it lacks an effect that was found.
    """
    posterior, fitted = model.posterior, model.fitted
    if not (lacking or is_chaotic(model) or posterior.batch.imposed):
        return likeliest_parameters(posterior, fitted.vector, units)
    known = uncertainty_at(posterior, fitted.vector, posterior.evaluated(fitted.vector), fitted.near)
    return estimates(posterior, known, units)


def said_of_errors(model: Model) -> str:
    """A warning that the stated errors of the `model` are too small; empty where they are not known to be."""
    return _CHAOTIC if is_chaotic(model) else ""


def message_of(model: Model) -> str:
    """The warning that the fit of `model` did not converge, or that parameters stopped at a bound; empty when there is
    none."""
    posterior, count = model.posterior, len(model.posterior.layout)
    bounded = at_a_bound(posterior.layout, model.fitted.vector[:count], posterior.start[:count])
    ending = [model.fitted.ending.value] if model.fitted.ending.value else []
    return " ".join(ending + ([f"At the end of its range: {', '.join(bounded)}."] if bounded else []))
