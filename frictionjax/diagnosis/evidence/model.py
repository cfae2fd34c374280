"""A fitted model structure, and how well it predicts the recordings."""

import equinox as eqx

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.estimation.descent.robust import Fitted
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics.effects import AbstractEffect, AbstractLoadEffect


class Model(eqx.Module):
    """A fitted structure: its `posterior` (with the slow observer), the result of the descent, `fitted`, and its
    `judgement`."""

    posterior: Posterior
    fitted: Fitted
    judgement: Judgement


def scene_of(model: Model, names: tuple[str, ...]) -> Scene:
    """All recordings, of these `names`, as the `model` observes them: with its integration steps and its observer."""
    posterior, held_out = model.posterior, model.judgement.held_out
    return Scene(posterior.batch, held_out, posterior.recordings.bandwidth, names)


def is_chaotic(model: Model) -> bool:
    """Whether impacts in a gap make the motion of the `model` chaotic."""
    return any(has_contacts(effect) for effect in model.judgement.drive.effects)


def has_contacts(effect: AbstractEffect) -> bool:
    """Whether the `effect` is a load that hits the ends of a gap."""
    return isinstance(effect, AbstractLoadEffect) and effect.chaotic
