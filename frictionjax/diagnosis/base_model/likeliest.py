"""The likeliest parameters of a model: those of `fit`, from where the robust descent ended.

The innovations of an observer whose gains are not those of the Kalman filter are correlated. The inverse information of
its descent counts them as white, and states errors that are several times too large where the sensor is fine.
A fixed-gain observer that is slow enough for a coarse sensor prefers friction that does not fall with velocity: noise
grows in an unstable motion, and a stable model leaves less. A Kalman filter knows how much noise grows.
"""

import dataclasses

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core import Estimate
from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.base_model.credibility import lost, reference_power
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import at_pace, is_coarse, pace_of, schedule_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.descent.refine import OneFit, Refined, at_start, refine
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.evidence import Observed, Positions
from frictionjax.estimation.objective.loss import Gaussian
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import changed
from frictionjax.estimation.uncertainty import estimates, inverse_of, uncertainty_at

_STEPS = 2  # integration steps a sample at least, as in `fit`
_FINER = 8  # so many times as many: the scheme is of second order, and 1/64 of the error is left
_ROUNDS = 3  # of Newton steps at most, each a few evaluations of fine steps: the first one does nearly all


def said_of_the_sensor(posterior: Posterior) -> tuple[str, ...]:
    """A sentence for the warnings where a sensor of the recordings of `posterior` is coarse."""
    if not is_coarse(posterior):
        return ()
    slowest = float(np.min(posterior.recordings.bandwidth))
    return (
        f"The position sensor is coarse: below its noise, forces that act faster than {slowest:.3g} Hz hide.",
    )


def likeliest(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
    """The `vector` with the parameters, and the starting deflections of the fitted recordings, that are likeliest for
    these recordings by the prediction errors of a Kalman filter (`refine`), from there.

    **Arguments:** `posterior`, of a diagnosis; `vector`, where its descent ended.
    """
    rows = np.flatnonzero(np.asarray(posterior.fitted[0]) > 0)
    places = np.concatenate([np.arange(posterior.parameters), posterior.parameters + rows])
    return changed(vector, places, _refined(posterior, vector, posterior.batch.substeps).vector)


def observed_as_asked(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    held_out: Bool[np.ndarray, " r"],
    *,
    rule: Rule = Rule(),
) -> tuple[Posterior, Float[Numbers, " q"]]:
    """The `posterior` with observers of the pace and the gains that its machine asks for, and the `likeliest`
    parameters from the `vector`.

    The machine is that of these parameters or that at the `vector`, with whose observers the innovations are likelier.
    Where much is missing, least squares may end at parameters of no machine, and a filter for them is of no use.
    Recordings that are predicted worse than by constant velocity keep constant gains: a filter that takes a moving
    machine for one in stick corrects less and less, and never comes back.

    **Arguments:** `posterior` and `vector`, where its descent ended; `held_out` (bool, shape `(r,)`); the `rule`.
    """
    ends = (likeliest(posterior, vector), vector)

    def asked_by(there: Float[Numbers, " q"]) -> Posterior:
        pace = pace_of(posterior.drive_of(there), posterior.batch, held_out, rule=rule)
        return at_pace(posterior, pace, schedule_of(posterior, there, pace, rule=rule))

    def cost(own: Posterior) -> float:
        return _spread(own) + float(np.min(own.misfits(ends)))

    return _without_lost(min((asked_by(there) for there in ends), key=cost), ends, rule), ends[0]


def _without_lost(posterior: Posterior, ends: tuple[Float[Numbers, " q"], ...], rule: Rule) -> Posterior:
    """The `posterior` with constant gains for the recordings that the better one of the `ends` loses, by the `rule`."""
    recordings, batch = posterior.recordings, posterior.batch
    assert isinstance(recordings, Observed)
    if recordings.schedule is None:
        return posterior
    best = ends[int(np.argmin(posterior.misfits(ends)))]
    reference = reference_power(posterior)
    power = judge(posterior, descend(posterior, best, graduate=False, steps=0)).power
    used = np.array(recordings.schedule.used)
    used[list(lost(reference, power, np.asarray(batch.block_count), rule))] = False
    schedule = dataclasses.replace(recordings.schedule, used=used)
    return at_pace(posterior, recordings.pace, schedule)


def _spread(posterior: Posterior) -> float:
    """Mean logarithm of the standard deviation of the innovations over that of the sensor's noise, in the fitted
    recordings: with the misfit, what a sample costs."""
    recordings = posterior.recordings
    assert isinstance(recordings, Observed)
    used = np.asarray(posterior.batch.valid) * np.asarray(posterior.fitted[0])[:, None]
    return float(np.sum(used * np.log(np.asarray(recordings.unit))) / max(float(np.sum(used)), 1.0))


def at_the_pace_of(model: Model, base: Model, *, remains: bool, rule: Rule = Rule()) -> Model | None:
    """The `base` model converged and judged with observers of the pace and the gains that the `model` asks for
    (`observed_as_asked`); None where the `model`, converged with them, misses no more by the `rule`, nor less if
    something `remains` with those of the base model.

    A filter for wrong parameters may be unstable where the machine is not: then it condemns the right model. Or it
    corrects more than the machine asks for, and hides what the model misses.
    """
    held_out, unit = model.judgement.held_out, np.ones((1, 1))
    asked, _ = observed_as_asked(model.posterior, model.fitted.vector, held_out, rule=rule)
    again = judge(asked, descend(asked, model.fitted.vector, graduate=False))
    more = np.array(again.misfits(unit)) - model.judgement.misfits(unit)
    if np.max(np.abs(more) if remains else more) <= rule.limits.adequate:
        return None
    recordings = asked.recordings
    assert isinstance(recordings, Observed)
    paced = at_pace(base.posterior, recordings.pace, recordings.schedule)
    fitted = descend(paced, base.fitted.vector, graduate=False)
    return Model(paced, fitted, judge(paced, fitted))


def likeliest_parameters(
    posterior: Posterior, vector: Float[Numbers, " q"], units: dict[str, str]
) -> dict[str, Estimate]:
    """Physical values of the `likeliest` parameters with the standard errors of `fit`.

    **Arguments:** `posterior`, `vector`: as there; `units` maps force, position, input to unit names.
    """
    found = _refined(posterior, vector, max(posterior.batch.substeps, _STEPS))
    fine, vector = _at_finer_steps(found)
    evaluations = fine.evaluated(vector)
    known = uncertainty_at(fine, vector, evaluations, fine.assembled(evaluations, vector))
    return estimates(fine, known, units)


def _at_finer_steps(found: Refined) -> tuple[Posterior, Float[np.ndarray, " q"]]:
    """The posterior that was `found`, with finer integration steps, and its minimum for the same gains, by Newton steps
    with the matrix of the coarse ones, where that is finite, as far as they lead down: at the steps of the fit
    stiffness and damping may be off by several standard errors."""
    posterior, vector = found.posterior, np.asarray(found.vector)
    (coarse,) = posterior.evidence
    assert isinstance(coarse, Positions)
    own = dataclasses.replace(coarse, substeps=_FINER * coarse.substeps)
    fine = eqx.tree_at(lambda p: p.evidence, posterior, (own,))
    hessian, near = np.asarray(posterior.near(vector).hessian), fine.near(vector)
    if not np.all(np.isfinite(hessian)):
        return fine, vector
    inverse = inverse_of(hessian)
    for _ in range(_ROUNDS):
        further = vector - inverse @ np.asarray(near.gradient)
        there = fine.near(further)
        if not float(there.cost) < float(near.cost):
            break
        vector, near = further, there
    return fine, vector


def _refined(posterior: Posterior, vector: Float[Numbers, " q"], substeps: int) -> Refined:
    """The minimum for the fitted recordings, with so many integration `substeps` a sample."""
    own, start = posterior.of_fitted(vector)
    gaussian = eqx.tree_at(
        lambda p: (p.loss, p.start, p.ceilings),
        own,
        (Gaussian(), start, (None,)),
        is_leaf=lambda leaf: leaf is None,
    )
    known = np.zeros(own.batch.x.shape[0], bool)
    return refine(OneFit(known, substeps), at_start(gaussian, start))
