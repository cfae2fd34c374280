"""Whether the base fit is credible: effects are named only where the base model explains the motion at least in part.

The reference is a prediction of constant velocity, which needs no model. A credible base model has smaller prediction
errors: in their energy, which the fast motion dominates, or for most of the time, which the slow motion dominates. One
of the two is enough, for each can fail on a good model: no model predicts a constant velocity better than the
reference, and one break-away that is predicted too late outweighs minutes of stick in the energy.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.judgement import by_cluster
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import OtherDecision
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.objective.misfit import block_misfits
from frictionjax.estimation.objective.posterior import Posterior

CREDIBLE = "base model is credible"


class Credibility(NamedTuple):
    """How the prediction errors of a fitted model compare with those of constant velocity, on the recordings that it
    was fitted to.

    **Attributes:** `energy` (share of the energy of the errors of constant velocity, above the noise and in blocks well
    above it, that the model removes; negative when its errors are larger), `lead` (gain in log-likelihood in the mean
    over clusters of 0.5 s, in standard errors of that mean), `failed` (numbers of the recordings in which the model is
    worse by both measures).
    """

    energy: float
    lead: float
    failed: tuple[int, ...]

    def is_credible(self, *, rule: Rule = Rule()) -> bool:
        """Whether the model removes half of the energy, or has a significant lead, by the `rule`."""
        return self.energy > rule.credible.energy or self.lead > rule.credible.lead

    @property
    def decision(self) -> OtherDecision:
        """The numbers that decide it."""
        return OtherDecision(CREDIBLE, {"energy": self.energy, "lead": self.lead})


def credibility(model: Model, *, rule: Rule = Rule()) -> Credibility:
    """Compare the fitted `model` with a prediction of constant velocity, by the numbers of the `rule`."""
    posterior = model.posterior
    reference = reference_power(posterior)
    power, count = model.judgement.power, np.asarray(posterior.batch.block_count)
    rows = np.flatnonzero(~model.judgement.held_out)
    worse = lost(reference, power, count, rule)
    failed = tuple(int(row) for row in rows if row in worse)
    return Credibility(*energy_and_lead(reference[rows], power[rows], count[rows], rule), failed)


def reference_power(posterior: Posterior) -> Float[np.ndarray, "r b"]:
    """Power of the innovations of each block of the recordings of the `posterior` where constant velocity is expected,
    shape `(r, b)`. Where the gains of the observer vary, that of constant gains or that of these, whichever leaves
    less: a filter that recovers follows the measured position, whatever its model says."""
    recordings, batch = posterior.recordings, posterior.batch
    reference = np.asarray(batch.block_mean(recordings.without_model() ** 2))
    if isinstance(recordings, Observed) and np.any(recordings.varies):
        observed = np.asarray(batch.block_mean(recordings.without_model_as_observed() ** 2))
        less = np.minimum(reference, observed)
        reference = np.where(np.asarray(recordings.varies)[:, None], less, reference)
    return reference


def lost(
    reference: Float[np.ndarray, "r b"],
    power: Float[np.ndarray, "r b"],
    count: Float[np.ndarray, "r b"],
    rule: Rule,
) -> tuple[int, ...]:
    """Numbers of the recordings in which a model is worse than the `reference` by both measures; arguments as of
    `energy_and_lead`."""
    return tuple(
        row
        for row in range(power.shape[0])
        if not _better(
            *energy_and_lead(reference[row : row + 1], power[row : row + 1], count[row : row + 1], rule)
        )
    )


def made_credible(before: Model, after: Sequence[Model], rule: Rule) -> tuple[bool, ...]:
    """Of each model `after` whether it is credible where the one `before` is not, by the `rule`."""
    if credibility(before, rule=rule).is_credible(rule=rule):
        return (False,) * len(after)
    return tuple(credibility(one, rule=rule).is_credible(rule=rule) for one in after)


def _better(energy: float, lead: float) -> bool:
    return energy >= 0.0 or lead > 0.0


def energy_and_lead(
    reference: Float[np.ndarray, "r b"],
    power: Float[np.ndarray, "r b"],
    count: Float[np.ndarray, "r b"],
    rule: Rule,
) -> tuple[float, float]:
    """Energy and lead of the block powers of a model, `power`, over those of the `reference`, for blocks of `count`
    samples, by the numbers of the `rule`; arrays of shape `(r, b)`."""
    # Noise raises half of the blocks a little above its mean, with a model and without: under a coarse encoder these
    # many would outvote the few with a signal.
    loud = count * (np.maximum(reference, power) > rule.credible.loud)
    before, after = (float(np.sum(loud * np.maximum(each - 1.0, 0.0))) for each in (reference, power))
    clusters = by_cluster(block_misfits(reference, count) - block_misfits(power, count))
    clusters = clusters[clusters != 0.0]
    lead = 0.0
    if clusters.size >= rule.credible.least_clusters:
        lead = float(clusters.mean() / max(float(clusters.std()) / np.sqrt(clusters.size), 1e-300))
    return 1.0 - after / before if before > 0.0 else -float(after > 0.0), lead
