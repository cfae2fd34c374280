"""Whether a model needs the recorded input: where it predicts as well without, u does not drive x, or the model is none
of the machine."""

import math

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evidence.ahead import held_out_ahead, typical_error
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.views import View, errors_ahead
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import OtherDecision

NOT_DRIVEN = (
    "u does not drive x: the model predicts the held-out recordings as well without any input. Check that u is the "
    "input that was applied, on the clock of x."
)

NOT_USED = (
    "No model here predicts the held-out recordings better with u than without any input, although u and x are "
    "coherent. Check that both are on one clock; if they are, what lies between them is not in the catalogue."
)

INPUT = "input is needed"


def with_and_without_input(model: Model, predicted: View, scene: Scene) -> OtherDecision:
    """How well the `model` predicts the held-out recordings with the recorded input, and with an input of zero.

    A model with enough effects can follow a motion that its input has nothing to do with: a spring makes it oscillate,
    and a dead zone lets no input through.

    **Arguments:**

    - `model`: the last model of a diagnosis.
    - `predicted`: what it predicts for the recordings of the `scene`.

    **Returns:** both errors 0.1 s ahead (`typical_error`), over the noise; that without input is infinite under an
    imposed motion, which has none.
    """
    dt = np.asarray(scene.batch.dt)
    error = typical_error(errors_ahead(predicted, scene), dt)
    if scene.batch.imposed:
        return OtherDecision(INPUT, {"error": error, "error_without_input": math.inf})
    u = np.zeros_like(np.asarray(scene.batch.u))  # type: ignore[attr-defined]
    silent = held_out_ahead(model, eqx.tree_at(lambda s: s.batch.u, scene, u))
    without = typical_error(silent, dt[scene.held_out])
    return OtherDecision(INPUT, {"error": error, "error_without_input": without})


def input_is_needed(compared: OtherDecision, rule: Rule) -> bool:
    """Whether the error without the input is larger than with it, by the `rule`, of what was `compared`."""
    without, error = compared.numbers["error_without_input"], compared.numbers["error"]
    return not without <= (1.0 + rule.credible.driven) * error
