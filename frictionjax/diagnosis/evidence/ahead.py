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
    old, new = (_logarithms(errors, dt) for errors in (before, after))
    return paired_lead(np.nan_to_num(old - new))


def typical_error(errors: Float[np.ndarray, "h n"], dt: Float[np.ndarray, " h"]) -> float:
    """Geometric mean over clusters of 0.5 s of the root mean square of the `errors`, in recordings of `dt` s a sample,
    as far as they are not NaN: one break-away that comes a moment too late does not outweigh all else."""
    return float(np.exp(np.nanmean(_logarithms(errors, dt))))


def _logarithms(errors: Float[np.ndarray, "h n"], dt: Float[np.ndarray, " h"]) -> Float[np.ndarray, " c"]:
    """Logarithm of the root mean square of the `errors` in each cluster of 0.5 s, NaN where all of them are."""
    found = []
    for own, step in zip(errors, dt, strict=True):
        length = max(round(CLUSTER * BLOCK / float(step)), 1)
        for start in range(0, own.size, length):
            there = own[start : start + length]
            there = there[~np.isnan(there)]
            with np.errstate(over="ignore"):
                square = np.clip(np.mean(there**2), _LEAST, _MOST) if there.size else np.nan
            found.append(0.5 * np.log(square))
    return np.array(found)
