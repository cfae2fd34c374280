"""How well a model predicts held-out recordings 0.1 s ahead."""

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.views import errors_ahead, view
from frictionjax.diagnosis.table import Lead, paired_lead
from frictionjax.estimation.data.batch import BLOCK, CLUSTER

_LEAST, _MOST = 1e-30, 1e30  # of a mean square over that of the noise: runs may overflow


def held_out_ahead(model: Model, scene: Scene | None = None) -> Float[np.ndarray, "h n"]:
    """Errors of the held-out positions that the `model` predicts 0.1 s ahead, over the noise; NaN where a recording
    has no samples. Under an imposed motion those of its force.

    **Arguments:** `model`; the recordings in the `scene`, None for those that the model was judged by.
    """
    own = model.judgement
    everything = scene_of(model, ("",) * own.held_out.size) if scene is None else scene
    rows = np.flatnonzero(everything.held_out)
    held_out = everything.of(rows)
    alone = Judgement(own.drive, own.deflection[rows], own.power[rows], own.held_out[rows], held_out.batch)
    return errors_ahead(view(alone, held_out), held_out)


def lead_ahead(
    before: Float[np.ndarray, "h n"], after: Float[np.ndarray, "h n"], dt: Float[np.ndarray, " h"]
) -> Lead:
    """By how much the errors `after` are smaller than those `before`, in logarithms of their root mean squares in
    clusters of 0.5 s: where a motion is unstable, noise grows to errors that outweigh all others.

    **Arguments:** `before`, `after`, of `held_out_ahead`, in recordings of `dt` s a sample.
    """
    gains = []
    for one, other, step in zip(before, after, dt, strict=True):
        length = max(round(CLUSTER * BLOCK / float(step)), 1)
        for start in range(0, one.size, length):
            old, new = (_mean_square(errors[start : start + length]) for errors in (one, other))
            gains.append(0.5 * np.log(old / new))
    return paired_lead(np.asarray(gains))


def _mean_square(errors: Float[np.ndarray, " n"]) -> float:
    there = errors[~np.isnan(errors)]
    with np.errstate(over="ignore"):
        return float(np.clip(np.mean(there**2), _LEAST, _MOST)) if there.size else 1.0
