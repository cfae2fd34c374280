"""A fitted model structure, and how well it predicts the recordings."""

import equinox as eqx
import jax
import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, Scene, Varying
from frictionjax.estimation.descent.robust import RobustFit
from frictionjax.estimation.evidence import Observed
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics.effects import AbstractEffect, AbstractLoadEffect


class Model(eqx.Module):
    """A fitted structure: its `posterior` (with the slow observer), the result of the descent, `fitted`, and its
    `judgement`."""

    posterior: Posterior
    fitted: RobustFit
    judgement: Judgement


def scene_of(model: Model, names: tuple[str, ...]) -> Scene:
    """All recordings, of these `names`, as the `model` observes them: with its integration steps and its observer."""
    posterior, held_out, varying = model.posterior, model.judgement.held_out, None
    recordings = posterior.recordings
    if isinstance(recordings, Observed) and np.any(recordings.varies):
        numbers = (recordings.gains, recordings.unit, recordings.varies)
        varying = Varying(*jax.tree.map(np.asarray, numbers))
    return Scene(posterior.batch, held_out, recordings.bandwidth, names, varying)


def is_chaotic(model: Model) -> bool:
    """Whether impacts in a gap make the motion of the `model` chaotic."""
    return any(has_contacts(effect) for effect in model.judgement.drive.effects)


def has_contacts(effect: AbstractEffect) -> bool:
    """Whether the `effect` is a load that hits the ends of a gap."""
    return isinstance(effect, AbstractLoadEffect) and effect.chaotic
