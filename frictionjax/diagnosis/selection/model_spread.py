"""Model spread: how far what a named effect leaves may have biased the parameters reported with it."""

import dataclasses
import math

import numpy as np

from frictionjax.core import Estimate
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import likelier
from frictionjax.diagnosis.selection.step import Step
from frictionjax.estimation.parameters import Free, part_of
from frictionjax.physics import Drive

_MOVED = (
    "The extended model does not reach the noise floor, so its parameters may be biased. Their errors include how far "
    "each moves when another effect that improves the fit is added, and may still be too small."
)


def moved(
    extended: dict[str, Estimate], layout: tuple[Free, ...], steps: list[Step], *, rule: Rule = Rule()
) -> tuple[dict[str, Estimate], str]:
    """The `extended` model's parameters with what other effects would make of them in their errors, and what is to be
    said of that; as they are, and nothing, where nothing is named or what is named leaves noise.

    Standard errors, those by clusters too, are about the nearest model of the named form. Where that form is an
    approximation its parameters are off by what is left, in all recordings alike. The last round of the selection
    refitted everything beside other effects that may be what is left, and refused them: the largest distance that a
    parameter went, s, is the spread between models, and its error becomes sqrt(stderr^2 + s^2) (variance within and
    between models: Draper 1995, without the weights, since none of these is the true one).

    **Arguments:**

    - `extended`: label -> `Estimate`.
    - `layout`: of the model that was named last; of its labels.
    - `steps`: the rounds of the selection.
    - `rule`: when a model leaves only noise, and what chance does not bring.
    """
    last = next((step.accepted for step in reversed(steps) if step.accepted is not None), None)
    if last is None or all(last.model.judgement.within(steps[-1].floor, rule.limits.adequate, rule=rule)):
        return extended, ""
    others, here, wider = _others(steps[-1], rule), steps[-1].before.judgement.drive, dict(extended)
    for free in layout:
        there = [np.asarray(part_of(drive, free.path)) for drive in others]
        distance = max(
            (float(np.max(np.abs(value - part_of(here, free.path)))) for value in there), default=0.0
        )
        own = extended[free.label]
        wider[free.label] = dataclasses.replace(own, stderr=math.hypot(own.stderr, distance))
    return wider, _MOVED


def _others(step: Step, rule: Rule) -> list[Drive]:
    """What a refused round made of the model, with each effect that chance does not bring; none where it accepted."""
    if step.accepted is not None:
        return []
    return [
        refit.model.judgement.drive
        for refit, row in zip(step.refits, step.compared, strict=True)
        if row.gains(rule).share > 0.0 and likelier(row, rule)
    ]
