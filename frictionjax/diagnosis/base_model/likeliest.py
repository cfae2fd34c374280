"""The likeliest parameters of a model whose sensor is coarse: those of `fit`, from where the robust descent ended.

A fixed-gain observer that is slow enough for a coarse sensor prefers friction that does not fall with velocity: noise
grows in an unstable motion, and a stable model leaves less. A Kalman filter knows how much noise grows.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate
from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import at_pace, pace_of, schedule_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.descent.refine import OneFit, Refined, at_start, refine
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.objective.loss import Gaussian
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import changed
from frictionjax.estimation.uncertainty import covariance_of, estimates

_STEPS = 2  # integration steps a sample at least, as in `fit`


def is_coarse(posterior: Posterior) -> bool:
    """Whether a sensor of the recordings is so coarse that its observer is slower than usual."""
    recordings = posterior.recordings
    return isinstance(recordings, Observed) and bool(np.any(np.asarray(recordings.pace) < 1.0))


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


def at_the_pace_of(model: Model, base: Model, *, rule: Rule = Rule()) -> Model | None:
    """The `base` model converged and judged with observers of the pace and the gains that the `likeliest` parameters of
    the `model` ask for; None where it has that pace, and the `model` misses as much with such gains, by the `rule`.

    A filter for wrong parameters may be unstable where the machine is not: then it condemns the right model.
    """
    posterior = model.posterior
    there = likeliest(posterior, model.fitted.vector)
    pace = pace_of(posterior.drive_of(there), posterior.batch, model.judgement.held_out, rule=rule)
    schedule = schedule_of(posterior, there, pace, rule=rule)
    if np.array_equal(pace, np.asarray(base.posterior.recordings.pace)):  # type: ignore[attr-defined]
        own = at_pace(posterior, pace, schedule)
        again = judge(own, descend(own, model.fitted.vector, graduate=False, steps=0))
        unit = np.ones((1, 1))
        fewer = np.array(model.judgement.misfits(unit)) - again.misfits(unit)
        if np.max(fewer) <= rule.limits.adequate:
            return None
    paced = at_pace(base.posterior, pace, schedule)
    fitted = descend(paced, base.fitted.vector, graduate=False)
    return Model(paced, fitted, judge(paced, fitted))


def likeliest_parameters(
    posterior: Posterior, vector: Float[Numbers, " q"], units: dict[str, str]
) -> dict[str, Estimate]:
    """Physical values of the `likeliest` parameters with the standard errors of `fit`.

    **Arguments:** `posterior`, `vector`: as there; `units` maps force, position, input to unit names.
    """
    found = _refined(posterior, vector, max(posterior.batch.substeps, _STEPS))
    evaluations = found.posterior.evaluated(found.vector)
    near = found.posterior.assembled(evaluations, found.vector)
    return estimates(found.posterior, found.vector, covariance_of(found.posterior, evaluations, near), units)


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
