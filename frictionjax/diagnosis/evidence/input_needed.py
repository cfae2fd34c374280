"""Whether a model needs the recorded input: where it predicts as well without, u does not drive x."""

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.views import View, held_out_error, view
from frictionjax.diagnosis.rule import Rule

NOT_DRIVEN = (
    "u does not drive x: the model predicts the held-out recordings as well without any input. Check that u is the "
    "input that was applied, on the clock of x."
)


def input_is_needed(model: Model, predicted: View, scene: Scene, *, rule: Rule = Rule()) -> bool:
    """Whether the `model` predicts the held-out recordings worse with an input of zero than with the recorded one.

    A model with enough effects can follow a motion that its input has nothing to do with: a spring makes it oscillate,
    and a dead zone lets no input through.

    **Arguments:**

    - `model`: the last model of a diagnosis.
    - `predicted`: what it predicts for the recordings of the `scene`.
    - `rule`: by how much the error must rise. An imposed motion has no input, and none is needed.
    """
    if scene.batch.imposed:
        return True
    own, rows = model.judgement, np.flatnonzero(scene.held_out)
    driven = scene.of(rows)
    u = np.zeros_like(np.asarray(driven.batch.u))  # type: ignore[attr-defined]
    held_out = eqx.tree_at(lambda s: s.batch.u, driven, u)
    batch = held_out.batch
    alone = Judgement(own.drive, own.deflection[rows], own.power[rows], own.held_out[rows], batch)
    without = held_out_error(view(alone, held_out), held_out)
    return is_worse(without, held_out_error(predicted, scene), rule=rule)


def is_worse(without: float, error: float, *, rule: Rule = Rule()) -> bool:
    """Whether the error `without` the input is larger than the `error` with it, by the `rule`; both in one unit."""
    return not without <= (1.0 + rule.credible.driven) * error
