"""How well a model predicts held-out recordings 0.1 s ahead."""

import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.views import held_out_error, view


def held_out_ahead(model: Model, scene: Scene | None = None) -> float:
    """Root mean square error, over the noise, of the held-out positions that the `model` predicts 0.1 s ahead.

    **Arguments:** `model`; the recordings in the `scene`, None for those that the model was judged by.
    """
    own = model.judgement
    everything = scene_of(model, ("",) * own.held_out.size) if scene is None else scene
    rows = np.flatnonzero(everything.held_out)
    held_out = everything.of(rows)
    alone = Judgement(own.drive, own.deflection[rows], own.power[rows], own.held_out[rows], held_out.batch)
    return held_out_error(view(alone, held_out), held_out)
