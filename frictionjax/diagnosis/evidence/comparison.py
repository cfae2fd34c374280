"""Comparison: a model with one more effect against the model without it."""

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, advantage, energy_explained, explained
from frictionjax.physics.effects import AbstractForceEffect

_WAVES, _WAVES_BESIDE = 1.0, 2.0  # along the stroke, and beside another force


class Compared(eqx.Module):
    """A refitted candidate against the model without it.

    **Attributes:** `share_fit`, `share_holdout` (share of the misfit above the floor that it removes), `energy_fit`,
    `energy_holdout` (share of the power), `lead_fit`, `lead_holdout` (gain in its standard errors, over clusters of
    0.5 s), `repeats` (whether all that is periodic along the stroke is seen to repeat in it).
    """

    share_fit: float
    share_holdout: float
    energy_fit: float
    energy_holdout: float
    lead_fit: float
    lead_holdout: float
    repeats: bool

    @property
    def worth(self) -> float:
        """Sum of the explained shares: what the candidates are ranked by."""
        return self.share_fit + self.share_holdout


def compare(before: Judgement, after: Judgement, floor: np.ndarray) -> Compared:
    """`after` against `before`, above the `floor` of each block."""
    held = before.held_out
    return Compared(
        *explained(before, after, floor),
        *energy_explained(before, after, floor),
        advantage(after, before, ~held, floor),
        advantage(after, before, held, floor),
        _repeats(after),
    )


def _repeats(found: Judgement) -> bool:
    """A wave that the stroke does not hold whole bends to any force that depends on the position; beside another force,
    a wave with its overtone bends to whatever that one leaves, unless it comes twice."""
    x = np.asarray(found.batch.x)[np.asarray(found.batch.valid) > 0.0]
    stroke = float(np.ptp(x)) if x.size else 0.0
    forces = [effect for effect in found.drive.effects if isinstance(effect, AbstractForceEffect)]
    return all(
        stroke >= (_WAVES_BESIDE if effect in forces and len(forces) > 1 else _WAVES) * abs(period)
        for effect in found.drive.effects
        for period in (float(getattr(effect, n.name)) for n in effect.nuisances if n.grid == "period")
    )
