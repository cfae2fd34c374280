"""Comparison: a model with one more effect against the model without it."""

import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement, by_cluster, energy_explained
from frictionjax.diagnosis.evidence.model import has_contacts
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import Lead, ModelComparison, paired_lead
from frictionjax.physics.effects import AbstractEffect, AbstractForceEffect

_SHORTEST = 1e-200  # of a period: what has none is periodic as often as one likes


def compare(
    before: Judgement,
    after: Judgement,
    floor: np.ndarray,
    *,
    added: AbstractEffect | None = None,
    p_value: float = 0.0,
    makes_credible: bool = False,
    ahead: Lead | None = None,
    rule: Rule = Rule(),
) -> ModelComparison:
    """`after` against `before`, above the `floor` of each block.

    **Arguments:**

    - `before`, `after`: one model, and the same with more effects.
    - `floor`: power of each block that a perfect model would leave.
    - `added`: the effect that is added; None where several are.
    - `p_value`: of the score test of the effect that is added; 0 where it has passed one before.
    - `makes_credible`, `ahead`: as in `ModelComparison`.
    - `rule`: for what enters the comparison itself (`Rule.floor`).
    """
    held = before.held_out
    gains = before.clusters(floor) - after.clusters(floor)
    scored = by_cluster(np.asarray(before.batch.block_count)) > 0
    return ModelComparison(
        before=forms_of(before),
        after=forms_of(after),
        effect=added.name if added is not None else "",
        form=type(added).__name__ if added is not None else "",
        exact=tuple(bool(one.about.one_law) for one in after.drive.effects[len(before.drive.effects) :]),
        misfits_before=before.misfits(floor),
        misfits_after=after.misfits(floor),
        misfit_errors=before.misfit_errors(),
        energies=energy_explained(before, after, floor, rule=rule),
        fit=paired_lead(gains[~held]),
        held_out=paired_lead(gains[held]),
        waves=_waves(after),
        free=int(np.asarray(after.vector).size - held.size),
        chaotic=any(map(has_contacts, after.drive.effects)),
        p_value=float(p_value),
        gains_fit=tuple(gains[~held][scored[~held]].tolist()),
        gains_held_out=tuple(gains[held][scored[held]].tolist()),
        makes_credible=makes_credible,
        ahead=ahead,
    )


def between(models: list[Judgement], floor: np.ndarray) -> tuple[tuple[int, int, Lead], ...]:
    """By how much each of the `models` leads each later one over all recordings, above the `floor`."""
    losses = [model.clusters(floor) for model in models]
    return tuple(
        (row, other, paired_lead(losses[other] - losses[row]))
        for row in range(len(models))
        for other in range(row + 1, len(models))
    )


def forms_of(judgement: Judgement) -> tuple[str, ...]:
    """Names of the forms of the effects in the model of the `judgement`."""
    return tuple(type(effect).__name__ for effect in judgement.drive.effects)


def _waves(found: Judgement) -> tuple[tuple[float, bool], ...]:
    """How many of each period the stroke holds, and whether it is that of a force beside another force."""
    x = np.asarray(found.batch.x)[np.asarray(found.batch.valid) > 0.0]
    stroke = float(np.ptp(x)) if x.size else 0.0
    forces = [effect for effect in found.drive.effects if isinstance(effect, AbstractForceEffect)]
    return tuple(
        (stroke / max(abs(period), _SHORTEST), bool(effect in forces and len(forces) > 1))
        for effect in found.drive.effects
        for period in (float(getattr(effect, n.name)) for n in effect.nuisances if n.grid == "period")
    )
