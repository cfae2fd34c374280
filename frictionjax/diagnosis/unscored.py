"""A case whose base fit is not credible: nothing is tested, refitted or named, and the reader is told what to check."""

import dataclasses
from collections.abc import Callable

from frictionjax.core import Estimate
from frictionjax.diagnosis.credible import Credibility, credibility
from frictionjax.diagnosis.evaluate import View, recording_fits
from frictionjax.diagnosis.judge import Scene
from frictionjax.diagnosis.refit import Model
from frictionjax.diagnosis.verdict import Candidate, Diagnosis, Unexplained
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Case

REASON = "not tested: the base fit is not credible"
SUMMARY = "Nothing was diagnosed: the base model could not be fitted to these recordings."

Refit = Callable[[Case], Model]
"""Fits the base model to a case."""


def mistake(case: Case, refit: Refit) -> str:
    """What is wrong with a case whose base fit is not credible, a sentence with its cure; empty when it is not known.

    The two mistakes that can be proved are tried: an input of the wrong sign, and a known inertia that contradicts the
    motor constant. What makes the fit credible is what was wrong.

    **Arguments:**

    - `case`: the case.
    - `refit`: fits the base model to a changed case.
    """
    for changed, cure in _mistakes(case):
        model = refit(changed)
        if credibility(model).credible:
            return cure(model)
    return ""


def what_to_check(found: Credibility, case: Case, known: str) -> str:
    """The warning: how bad the base fit is, and what mends it.

    **Arguments:**

    - `found`: what the base fit explains.
    - `case`: the case.
    - `known`: the `mistake` that was found, or nothing.
    """
    said = (
        "The base fit is not credible: it predicts the motion no better than no model would, which expects the machine "
        f"to keep its speed ({100 * max(found.energy, -9.99):.0f} % of the energy explained)."
    )
    if known:
        return f"{said} Nothing was tested or named. {known}"
    said = f"{said} No effect of the catalogue mends that, and nothing is named."
    names = [case.fit_recordings[row].name for row in found.failed]
    worst = f" It is worse in {', '.join(names)}." if names else ""
    return (
        f"{said}{worst} Check that u is what drives x (columns, and one clock for both), its sign, the units of time "
        "and position, and whether something else moves the machine."
    )


def unscored(
    case: Case,
    base: Model,
    scene: Scene,
    seen: View,
    parameters: dict[str, Estimate],
    warnings: tuple[str, ...],
    seconds: dict[str, float],
) -> Diagnosis:
    """The diagnosis of a `case` that was not scored: `unknown`, nothing missing by name, every effect untested.

    **Arguments:**

    - `case`: the case.
    - `base`, `scene`, `seen`: its base fit, its recordings, and what the one says of the others, for pictures.
    - `parameters`: where the base fit ended.
    - `warnings`: sentences, that of `what_to_check` first.
    - `seconds`: stage to s.
    """
    recordings = case.fit_recordings + case.holdout_recordings
    return Diagnosis(
        case=case.name,
        plant=case.plant,
        verdict="unknown",
        summary=SUMMARY,
        missing=(),
        unexplained=Unexplained(True, 1.0, ""),
        mismatch=(),
        base=parameters,
        extended=parameters,
        recordings=recording_fits(recordings, scene, seen, seen, base.judgement.drive),
        candidates=tuple(Candidate(name, float("nan"), {}, False, REASON) for name in catalogue()),
        warnings=warnings,
        seconds=seconds,
    )


def _mistakes(case: Case) -> list[tuple[Case, Callable[[Model], str]]]:
    """Changed cases, and what is to be said when the base model fits them."""
    reversed_input = dataclasses.replace(
        case, recordings=tuple(dataclasses.replace(r, u=-r.u) for r in case.recordings)
    )
    found: list[tuple[Case, Callable[[Model], str]]] = [
        (
            reversed_input,
            lambda model: (
                "With the sign of u changed it is: a positive input moves x backwards. Set "
                "scale = {u = -1.0}."
            ),
        )
    ]
    known = case.plant.inertia
    if known is not None:
        found.append(
            (
                dataclasses.replace(case, plant=dataclasses.replace(case.plant, inertia=None)),
                lambda model: (
                    f"With a free inertia it is, at {float(model.judgement.drive.J):.3g} instead of {known:.3g}: the "
                    "inertia and the motor constant contradict each other. Correct one of them, or leave it out."
                ),
            )
        )
    return found
