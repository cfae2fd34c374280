"""The base model fitted to a case: LuGre and the inertia, from every starting value, robust against what it lacks."""

from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from frictionjax.core import Estimate, Progress
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, is_chaotic
from frictionjax.diagnosis.evidence.noise_floor import predictable
from frictionjax.diagnosis.evidence.step_length import steps_needed, with_steps
from frictionjax.diagnosis.intake.starting_point import Beginning
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.finer import at_finer_steps
from frictionjax.estimation.descent.robust import Fitted, descend
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.parameters import at_a_bound
from frictionjax.estimation.uncertainty import covariance_of, estimates
from frictionjax.physics import Drive

_SETTLING = 8  # steps of a descent without what cannot be foreseen
_SEEN = 3.0  # times its standard error with it, that a parameter may have without
_COARSE = (
    "The parameters are those of few integration steps a sample, from which finer steps lead far away: they may be off "
    "by more than their errors."
)

_CHAOTIC = (
    "The contacts of a gap make the motion chaotic: the errors that are stated are those of the blocks in which it is "
    "not, and too small."
)


def base_of(begun: Beginning, executor: Executor, progress: Progress, *, known_inertia: bool) -> Model:
    """The base model fitted to the recordings of `begun` that are not held out; `known_inertia` keeps J."""
    return fit_base(
        begun.start.drives, begun.batch, begun.held_out, executor, progress, known_inertia=known_inertia
    )


def fit_base(
    starts: Sequence[Drive],
    batch: AbstractBatch,
    held_out: np.ndarray,
    executor: Executor,
    progress: Progress,
    *,
    known_inertia: bool = False,
) -> Model:
    """Fit inertia and LuGre parameters to the recordings of `batch` that are not `held_out`, robustly.

    A model with something missing has several minima, and which is the best is not to be seen after a few steps: every
    one of the `starts` goes down with the fast observer, and the two that come lowest go on with the slow one. The best
    ends with as many integration steps a sample as it needs (`steps_needed`), which the model keeps.

    **Raises:** `ValueError` when no start gives finite predictions.
    """
    progress(f"base fit: {len(starts)} starting values", 0.0)
    # Each within its own range: where starts lie orders of magnitude apart, that of one does not hold the others.
    begun = [robust_posterior(start, batch, held_out, known_inertia=known_inertia) for start in starts]
    reached = list(executor.map(lambda pair: descend(*pair, steps=15, tolerance=0.02), begun))
    order = sorted(range(len(starts)), key=lambda number: reached[number].misfit)
    progress("base fit: slow observer", 0.6)
    best = [number for number in order[:2] if np.isfinite(reached[number].misfit)]
    slow = [begun[number][0].at_bandwidth(SLOW_BANDWIDTH) for number in best]
    ends = list(
        executor.map(lambda joint, number: descend(joint, reached[number].vector, graduate=False), slow, best)
    )
    if not ends:
        raise ValueError(
            "No starting value gives finite predictions; check `drive`, and the units of the recordings and of "
            "the motor constant."
        )
    joint, fitted = min(zip(slow, ends, strict=True), key=lambda pair: pair[1].misfit)
    steps = steps_needed(joint, fitted.vector)
    if steps > 1:
        progress(f"base fit: {steps} integration steps a sample", 0.8)
        joint = with_steps(joint, steps)
        fitted = descend(joint, fitted.vector, graduate=False)
    return Model(joint, fitted, judge(joint, fitted))


def parameters_of(model: Model, units: dict[str, str], force: float = 0.0) -> dict[str, Estimate]:
    """Physical values of the free parameters of `model`, without the error of the integration, with standard errors
    that are rather large than small (`clustered_covariance`).

    **Arguments:**

    - `model`: the fitted model.
    - `units`: maps force, position, input to unit names.
    - `force`: unmeasured force over Fc: what it makes unpredictable tells nothing.
    """
    return told_parameters(model, units, force)[0]


def told_parameters(
    model: Model, units: dict[str, str], force: float = 0.0, *, lacking: bool = False
) -> tuple[dict[str, Estimate], str]:
    """The same, and what is to be said of them: that the error of the integration is still in them, or that the stated
    errors are too small; empty when there is nothing. A model that is `lacking` an effect keeps the error of the
    integration: what it lacks bends its parameters by far more."""
    chaotic = is_chaotic(model)
    joint, fitted = (model.joint, model.fitted) if chaotic else _foreseen(model, force)
    vector, away, evaluations = fitted.vector, False, joint.evaluated(fitted.vector)
    if not lacking:
        vector, away = at_finer_steps(joint, fitted.vector, fitted.near, evaluations[0])
    # Of few steps: their error scatters like noise, and stands for what finer steps leave of it.
    covariance = covariance_of(joint, evaluations, fitted.near)
    message = " ".join(text for text, holds in ((_COARSE, away), (_CHAOTIC, chaotic)) if holds)
    return estimates(joint, vector, covariance, units), message


def _foreseen(model: Model, force: float) -> tuple[Posterior, Fitted]:
    """`model` fitted once more without the blocks that a `force` makes unpredictable; as it is where there are none, or
    where one of its parameters is hardly seen in the others."""
    joint, fitted = model.joint, model.fitted
    if force == 0.0 or joint.batch.imposed:
        return joint, fitted
    calm, less = predictable(joint, fitted.vector, force)
    if not less:
        return joint, fitted
    again = descend(calm, fitted.vector, graduate=False, steps=_SETTLING, tolerance=1e-4)
    curved = [np.asarray(one.near.hessian) for one in (fitted, again)]
    if not np.all(np.isfinite(curved)):
        return joint, fitted
    before, after = (np.linalg.pinv(hessian, hermitian=True) for hessian in curved)
    count = len(joint.layout)
    known = np.diag(after)[:count] < _SEEN**2 * np.diag(before)[:count]
    return (calm, again) if np.all(known) else (joint, fitted)


def message_of(model: Model) -> str:
    """What is to be said of the fit: that it did not come to rest, or which parameters stopped at an end of their
    range; empty when there is nothing."""
    joint, count = model.joint, len(model.joint.layout)
    ends = at_a_bound(joint.layout, model.fitted.vector[:count], joint.start[:count])
    said = [model.fitted.ending.value] if model.fitted.ending.value else []
    return " ".join(said + ([f"At the end of its range: {', '.join(ends)}."] if ends else []))
