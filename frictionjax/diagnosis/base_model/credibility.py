"""Is the base fit credible at all? What a base fit that explains nothing leaves over is no physics to be named.

Without any model a machine is best expected to keep its speed. A base model that knows how the input moves the machine
errs less than that: in the energy of its prediction errors, which the fast motion decides, or in most of the time,
which the slow motion decides. One of the two is enough, for each has machines in which it says little: at constant
speed nobody beats who expects constant speed, and one break-away that is predicted too late outweighs minutes of stick.
"""

from typing import NamedTuple

import numpy as np

from frictionjax.diagnosis.evidence.model import Model
from frictionjax.estimation.data.batch import CLUSTER

_HALF = 0.5  # of the energy
_SURE = 3.0  # standard errors
_SEEN = 2.0  # power of a block, in units of the noise, from which on its energy counts
_FEW = 4  # clusters: with fewer there is no standard error


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

    @property
    def credible(self) -> bool:
        """Whether the model explains half of the energy, or more of most of the time than chance would."""
        return self.energy > _HALF or self.lead > _SURE


def credibility(model: Model) -> Credibility:
    """Hold the fitted `model` against no model."""
    joint = model.joint
    none = np.asarray(joint.batch.block_mean(joint.recordings.without_model() ** 2))
    told, count = model.judgement.power, np.asarray(joint.batch.block_count)
    rows = np.flatnonzero(~model.judgement.held_out)
    failed = tuple(
        int(row)
        for row in rows
        if not _better(*_compared(none[row : row + 1], told[row : row + 1], count[row : row + 1]))
    )
    return Credibility(*_compared(none[rows], told[rows], count[rows]), failed)


def _better(energy: float, lead: float) -> bool:
    return energy >= 0.0 or lead > 0.0


def _compared(none: np.ndarray, told: np.ndarray, count: np.ndarray) -> tuple[float, float]:
    """Energy and lead of block powers `told` over those of no model, shape `(r, b)`, of so many samples each."""
    # Noise lifts half of the blocks a little above its mean, with a model and without: under a coarse encoder these
    # many would outvote the few that show anything.
    seen = count * (np.maximum(none, told) > _SEEN)
    before, after = (float(np.sum(seen * np.maximum(power - 1.0, 0.0))) for power in (none, told))
    gain = 0.5 * count * np.log((none + 1.0) / (told + 1.0))
    short = -gain.shape[1] % CLUSTER
    clusters = np.pad(gain, ((0, 0), (0, short))).reshape(gain.shape[0], -1, CLUSTER).sum(-1)
    clusters = clusters[clusters != 0.0]
    lead = 0.0
    if clusters.size >= _FEW:
        lead = float(clusters.mean() / max(float(clusters.std()) / np.sqrt(clusters.size), 1e-300))
    return 1.0 - after / before if before > 0.0 else -float(after > 0.0), lead
