"""Moved: how far what a named effect leaves may have moved the parameters told with it."""

import dataclasses
import math

import numpy as np

from frictionjax.core import Estimate
from frictionjax.diagnosis.evidence.judgement import ADEQUATE_MISFIT
from frictionjax.diagnosis.selection.decide import Step, clear, effect_p_values
from frictionjax.estimation.parameters import Free, part_of
from frictionjax.physics import Drive

_MOVED = (
    "The extended model leaves more than noise, which may have moved its parameters: their errors include how far each "
    "goes when another effect that clearly gains is tried beside what is named, and may still be too small."
)


def moved(
    extended: dict[str, Estimate], layout: tuple[Free, ...], steps: list[Step]
) -> tuple[dict[str, Estimate], str]:
    """The `extended` model's parameters with what other effects would make of them in their errors, and what is to be
    said of that; as they are, and nothing, where nothing is named or what is named leaves noise.

    Standard errors, those of the sandwich too, are about the nearest model of the named form. Where that form is a
    likeness its parameters are off by what is left, in all recordings alike. The last round of the selection refitted
    everything beside other effects that may be what is left, and refused them: the largest distance that a parameter
    went, s, is the spread between models, and its error becomes sqrt(stderr^2 + s^2) (variance within and between
    models: Draper 1995, without the weights, since none of these is the true one).

    **Arguments:**

    - `extended`: label -> `Estimate`.
    - `layout`: of the model that was named last; of its labels.
    - `steps`: the rounds of the selection.
    """
    last = next((step.accepted for step in reversed(steps) if step.accepted is not None), None)
    if last is None or all(last.model.judgement.within(steps[-1].floor, ADEQUATE_MISFIT)):
        return extended, ""
    others, here, told = _others(steps[-1]), steps[-1].before.judgement.drive, dict(extended)
    for free in layout:
        there = [np.asarray(part_of(drive, free.path)) for drive in others]
        distance = max(
            (float(np.max(np.abs(value - part_of(here, free.path)))) for value in there), default=0.0
        )
        own = extended[free.label]
        told[free.label] = dataclasses.replace(own, stderr=math.hypot(own.stderr, distance))
    return told, _MOVED


def _others(step: Step) -> list[Drive]:
    """What a refused round made of the model, with each effect that chance does not bring; none where it accepted."""
    if step.accepted is not None:
        return []
    before, p_values = step.before.judgement, effect_p_values(step.trials)
    return [
        refit.model.judgement.drive
        for refit, compared in zip(step.refits, step.compared, strict=True)
        if min(compared.share_fit, compared.share_holdout) > 0.0
        and clear(compared, before, step.floor, p_values[refit.effect])
    ]
