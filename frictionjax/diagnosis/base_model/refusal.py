"""A base fit that is not credible: which error in the case explains it, and what to check."""

import dataclasses
from collections.abc import Callable

from frictionjax.diagnosis.base_model.credibility import Credibility, credibility
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.rule import Rule
from frictionjax.recordings import Case

Refit = Callable[[Case], Model]
"""Fits the base model to a case."""


def mistake(case: Case, refit: Refit, *, rule: Rule = Rule()) -> str:
    """The error in a case whose base fit is not credible, a sentence with its cure; empty when none is found.

    Two errors are tried: an input of the wrong sign, and a known inertia that contradicts the motor constant. The first
    whose correction makes the fit credible is reported.

    **Arguments:**

    - `case`: the case.
    - `refit`: fits the base model to a changed case.
    - `rule`: when a base fit is credible.
    """
    for changed, cure in _mistakes(case):
        model = refit(changed)
        if credibility(model, rule=rule).is_credible(rule=rule):
            return cure(model)
    return ""


def what_to_check(found: Credibility, case: Case, known: str) -> str:
    """The warning: how bad the base fit is, and what corrects it or is to be checked.

    **Arguments:**

    - `found`: how the base fit compares with constant velocity.
    - `case`: the case.
    - `known`: the sentence of `mistake`, or empty.
    """
    finding = (
        "The base fit is not credible: it predicts the motion no better than assuming constant velocity "
        f"({100 * max(found.energy, -9.99):.0f} % of the energy explained)."
    )
    if known:
        return f"{finding} No effect was tested or named. {known}"
    finding = f"{finding} No effect of the catalogue makes it credible, so none is named."
    names = [case.fit_recordings[row].name for row in found.failed]
    worst = f" It is worse in {', '.join(names)}." if names else ""
    return (
        f"{finding}{worst} Check that u is what drives x (columns, and one clock for both), its sign, the units of "
        "time and position, and whether something else moves the machine."
    )


def _mistakes(case: Case) -> list[tuple[Case, Callable[[Model], str]]]:
    """Corrected cases, and the sentence to report when the base model fits them."""
    reversed_input = dataclasses.replace(
        case, recordings=tuple(dataclasses.replace(r, u=-r.u) for r in case.recordings)
    )
    found: list[tuple[Case, Callable[[Model], str]]] = [
        (
            reversed_input,
            lambda model: (
                "Set scale = {u = -1.0}: a positive input moves x backwards, since with the sign of u reversed the "
                "base model fits."
            ),
        )
    ]
    known = case.plant.inertia
    if known is not None:
        found.append(
            (
                dataclasses.replace(case, plant=dataclasses.replace(case.plant, inertia=None)),
                lambda model: (
                    f"Correct the inertia or the motor constant, or leave one of them out: they contradict each other, "
                    f"since the base model fits with an inertia of {float(model.judgement.drive.J):.3g} instead of "
                    f"{known:.3g}."
                ),
            )
        )
    return found
