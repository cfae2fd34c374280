"""A candidate that was refitted, and the last steps of its fit."""

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.score_test import Trial
from frictionjax.estimation.descent.robust import descend
from frictionjax.physics.effects import AbstractEffect


class Refitted(eqx.Module):
    """A candidate, refitted.

    **Attributes:** `trial`, `model`.
    """

    trial: Trial
    model: Model

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.trial.effect

    @property
    def own_effect(self) -> AbstractEffect:
        """The effect in the model, as refitted: not always the last one of its drive."""
        effects = self.model.judgement.drive.effects
        return next(one for one in reversed(effects) if one.name == self.effect)

    @property
    def form(self) -> str:
        """Name of its form."""
        return type(self.trial.form).__name__


def polish(candidate: Refitted, *, effort: Effort = Effort()) -> Refitted:
    """The same refit, converged: for those that may be named."""
    model = candidate.model
    fitted = descend(
        model.posterior, model.fitted.vector, graduate=False, steps=effort.refitting.polish_steps
    )
    return Refitted(candidate.trial, Model(model.posterior, fitted, judge(model.posterior, fitted)))


def ease(model: Model, *, rule: Rule = Rule(), effort: Effort = Effort()) -> Model:
    """The same model, refitted where it is far from the noise of an imposed motion's force: errors are then weighed
    against a third of what it leaves in the middle one of the blocks, and a step of the selection finds the candidate
    that removes most of them.

    Against the noise the cost of a block is the logarithm of its error. A model that is everywhere fifty times worse
    would be fitted to the blocks in which its error happens to pass through zero.
    """
    batch = model.posterior.batch
    if not batch.imposed:
        return model
    scored = (np.asarray(batch.block_count) > 0) & (np.asarray(model.posterior.fitted[0])[:, None] > 0)
    wanted, now = ease_of(model.judgement.power[scored], rule), batch.ease  # type: ignore[attr-defined]
    if abs(np.log(wanted / float(now[0]))) < effort.refitting.eased:
        return model
    posterior = eqx.tree_at(lambda j: j.evidence[0].batch.ease, model.posterior, np.full_like(now, wanted))
    fitted = descend(posterior, model.fitted.vector, graduate=False)
    return Model(posterior, fitted, judge(posterior, fitted))


def ease_of(power: np.ndarray, rule: Rule) -> float:
    """The level that errors are weighed against where a model leaves blocks of this `power`, in noise levels."""
    return max(np.sqrt(rule.floor.ease * float(np.median(power))), 1.0)
