"""Is the base fit credible at all? What a base fit that explains nothing leaves over is no physics to be named.

Without any model a machine is best expected to keep its speed. A base model that knows how the input moves the machine
errs less than that: in the energy of its prediction errors, which the fast motion decides, or in most of the time,
which the slow motion decides. One of the two is enough, for each has machines in which it says little: at constant
speed nobody beats who expects constant speed, and one break-away that is predicted too late outweighs minutes of stick.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.data.no_model import innovations_without_model
from frictionjax.estimation.objective.joint import Joint
from frictionjax.estimation.objective.look import CLUSTER_BLOCKS


class Credibility(NamedTuple):
    """How the prediction errors of a fitted model compare with those of no model, on the recordings that it was fitted
    to.

    **Attributes:** `energy` (part of the energy of the errors of no model, above the noise and in blocks that stand
    out of it, that the model removes; below 0 when it errs more), `lead` (how much likelier it is in the mean over
    clusters of 0.5 s, in standard errors of that mean), `failed` (numbers of the recordings that it makes worse in both
    ways).
    """

    energy: float
    lead: float
    failed: tuple[int, ...]

    def is_credible(self, *, rule: Rule = Rule()) -> bool:
        """Whether, by the `rule`, the model explains half of the energy, or more of most of the time than chance
        would."""
        return self.energy > rule.credible.energy or self.lead > rule.credible.lead


def credibility(model: Model, *, rule: Rule = Rule()) -> Credibility:
    """Compare the fitted `model` with no model, by the numbers of the `rule`."""
    joint = model.joint
    none = np.asarray(joint.batch.block_mean(_without_model(joint) ** 2))
    power, count = model.judgement.power, np.asarray(joint.batch.block_count)
    rows = np.flatnonzero(~model.judgement.held_out)
    failed = tuple(
        int(row)
        for row in rows
        if not _better(
            *energy_and_lead(none[row : row + 1], power[row : row + 1], count[row : row + 1], rule)
        )
    )
    return Credibility(*energy_and_lead(none[rows], power[rows], count[rows], rule), failed)


def _without_model(joint: Joint) -> Float[Array, "r n"]:
    """Standardised errors of no model: the machine keeps its speed; under an imposed motion friction is constant."""
    batch = joint.batch
    if isinstance(batch, ImposedBatch):
        mean = jnp.sum(batch.force * batch.valid, axis=1) / jnp.sum(batch.valid, axis=1)
        return (batch.force - mean[:, None]) / (batch.noise * batch.ease)[:, None] * batch.valid
    assert isinstance(batch, Batch)
    return jnp.asarray(innovations_without_model(batch, joint.setting.gains))


def _better(energy: float, lead: float) -> bool:
    return energy >= 0.0 or lead > 0.0


def energy_and_lead(
    none: np.ndarray, fitted: np.ndarray, count: np.ndarray, rule: Rule
) -> tuple[float, float]:
    """Energy and lead of the block powers of a `fitted` model over those of no model.

    **Arguments:** powers with no model, `none`, and with the `fitted` one, shape `(r, b)`; the `count` of samples of
    each block; the `rule`.
    """
    # Noise lifts half of the blocks a little above its mean, with a model and without: under a coarse encoder these
    # many would outvote the few that show anything.
    loud = count * (np.maximum(none, fitted) > rule.credible.loud)
    before, after = (float(np.sum(loud * np.maximum(power - 1.0, 0.0))) for power in (none, fitted))
    gain = 0.5 * count * np.log((none + 1.0) / (fitted + 1.0))
    short = -gain.shape[1] % CLUSTER_BLOCKS
    clusters = np.pad(gain, ((0, 0), (0, short))).reshape(gain.shape[0], -1, CLUSTER_BLOCKS).sum(-1)
    clusters = clusters[clusters != 0.0]
    lead = 0.0
    if clusters.size >= rule.credible.least_clusters:
        lead = float(clusters.mean() / max(float(clusters.std()) / np.sqrt(clusters.size), 1e-300))
    return 1.0 - after / before if before > 0.0 else -float(after > 0.0), lead
