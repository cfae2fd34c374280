"""The base model fitted to a case: LuGre and inertia, from every starting value, by a robust loss."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Bool

from frictionjax.core import Estimate, Progress
from frictionjax.diagnosis.base_model.likeliest import likeliest_parameters, observed_as_asked
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import predictable
from frictionjax.diagnosis.evidence.pace import at_pace, is_coarse, pace_of
from frictionjax.diagnosis.evidence.step_length import steps_needed, with_steps
from frictionjax.diagnosis.intake.starting_point import StartingPoint
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.finer import at_finer_steps
from frictionjax.estimation.descent.robust import RobustFit, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import robust_posterior
from frictionjax.estimation.parameters import at_a_bound
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.uncertainty import estimates, uncertainty_at
from frictionjax.physics import Drive

_SETTLING = 8  # steps of a descent without the unpredictable blocks
_LESS_CERTAIN = 3.0  # factor by which the standard error of a parameter may grow without those blocks
_COARSE = (
    "Parameters change by more than their standard errors when the integration step is refined; treat the stated "
    "errors as too small."
)
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


def parameters_of(
    model: Model, units: dict[str, str], force: float = 0.0, *, rule: Rule = Rule()
) -> dict[str, Estimate]:
    """Physical values of the free parameters of `model`, corrected for the integration error, with standard errors that
    allow for correlated innovations (`clustered_covariance`).

    **Arguments:**

    - `model`: the fitted model.
    - `units`: maps force, position, input to unit names.
    - `force`: unmeasured force over Fc; the blocks that it makes unpredictable are left out.
    - `rule`: when a block is unpredictable.
    """
    return reported_parameters(model, units, force, rule=rule)[0]


def reported_parameters(
    model: Model,
    units: dict[str, str],
    force: float = 0.0,
    *,
    lacking: bool = False,
    rule: Rule = Rule(),
) -> tuple[dict[str, Estimate], str]:
    """`parameters_of` the `model`, with the same `units` and `force`, and a warning about them: that the integration
    error is still in them, or that the stated errors are too small; empty when there is none. A model that is `lacking`
    an effect is not corrected for the integration error: the missing effect biases its parameters by far more. Under a
    coarse sensor the parameters are the likeliest ones, as of `fit`."""
    chaotic = is_chaotic(model)
    if is_coarse(model.posterior) and not chaotic and not lacking:
        return likeliest_parameters(model.posterior, model.fitted.vector, units), ""
    posterior, fitted = (
        (model.posterior, model.fitted) if chaotic else _predictable_only(model, force, rule=rule)
    )
    vector, coarse, evaluations = fitted.vector, False, posterior.evaluated(fitted.vector)
    if not lacking:
        vector, coarse = at_finer_steps(posterior, fitted.vector, fitted.near, evaluations[0])
    # At the steps of the fit: their integration error scatters like noise, and stands for that of finer steps.
    known = uncertainty_at(posterior, vector, evaluations, fitted.near)
    message = " ".join(text for text, applies in ((_COARSE, coarse), (_CHAOTIC, chaotic)) if applies)
    return estimates(posterior, known, units), message


def _predictable_only(model: Model, force: float, *, rule: Rule) -> tuple[Posterior, RobustFit]:
    """The `model` fitted again without the blocks that a `force` makes unpredictable, by the `rule`; unchanged where
    there are none, or where the other blocks hardly determine one of its parameters."""
    posterior, fitted = model.posterior, model.fitted
    if force == 0.0 or posterior.batch.imposed:
        return posterior, fitted
    reduced, some = predictable(posterior, fitted.vector, force, rule=rule)
    if not some:
        return posterior, fitted
    again = descend(reduced, fitted.vector, graduate=False, steps=_SETTLING, tolerance=1e-4)
    hessians = [np.asarray(one.near.hessian) for one in (fitted, again)]
    if not np.all(np.isfinite(hessians)):
        return posterior, fitted
    before, after = (np.linalg.pinv(hessian, hermitian=True) for hessian in hessians)
    count = len(posterior.layout)
    determined = np.diag(after)[:count] < _LESS_CERTAIN**2 * np.diag(before)[:count]
    return (reduced, again) if np.all(determined) else (posterior, fitted)


def message_of(model: Model) -> str:
    """The warning that the fit of `model` did not converge, or that parameters stopped at a bound; empty when there is
    none."""
    posterior, count = model.posterior, len(model.posterior.layout)
    bounded = at_a_bound(posterior.layout, model.fitted.vector[:count], posterior.start[:count])
    ending = [model.fitted.ending.value] if model.fitted.ending.value else []
    return " ".join(ending + ([f"At the end of its range: {', '.join(bounded)}."] if bounded else []))
