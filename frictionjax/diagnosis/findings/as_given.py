"""The user's own model as it was given, nothing fitted: what it predicts for every recording."""

import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.views import View, view
from frictionjax.diagnosis.intake.starting_point import StartingPoint
from frictionjax.physics.effects import AbstractEffect


def view_as_given(
    starting: StartingPoint, scene: Scene, silent_effects: tuple[AbstractEffect, ...] = ()
) -> View | None:
    """What the user's own model predicts for the recordings of the `scene` with the values that the case gives; None
    where it does not give all of them.

    **Arguments:**

    - `starting`: with the model.
    - `scene`: all recordings.
    - `silent_effects`: what the extended model has beyond it, at zero strength, so that both share one program.
    """
    if not starting.own.complete:
        return None
    drive = starting.own.applied(starting.start.drives[0]).with_effects(*silent_effects)
    held_out, batch = scene.held_out, scene.batch
    power = np.ones(np.asarray(batch.block_count).shape)
    return view(Judgement(drive, np.zeros(held_out.size), power, held_out, batch), scene)
