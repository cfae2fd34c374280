"""The verdict in plain words."""

import math

from frictionjax.core.quantities import DisplayUnit, in_unit
from frictionjax.diagnosis.recording_fit import RecordingFit, Unmeasured
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import Ceiling, MissingEffect, SimulationAsGiven, Unexplained


def summary_sentence(
    verdict: str,
    missing: tuple[MissingEffect, ...],
    unexplained: Unexplained,
    where: str,
    fits: tuple[RecordingFit, ...],
    unmeasured: Unmeasured | None = None,
    unit: str | DisplayUnit = "",
    ceiling: Ceiling | None = None,
    *,
    position_unit: str | DisplayUnit = "",
    given: SimulationAsGiven | None = None,
    rule: Rule = Rule(),
) -> str:
    """The sentence that opens the report.

    **Arguments:**

    - `verdict`: `"adequate"`, `"named"` or `"unknown"`.
    - `missing`: the named effects, strongest first.
    - `unexplained`: what remains.
    - `where`: where the base model's mismatch is, in words.
    - `fits`: the recordings, for the held-out errors.
    - `unmeasured`: the force that the model needs beside it, in the force `unit`.
    - `ceiling`: what a free force would explain beside the last model.
    - `position_unit`: of the errors; those of an imposed motion are in the force `unit`.
    - `given`: the user's own simulation, compared; its sentence is the last one where it is a column of the recordings.
    - `rule`: from where that force is stated.
    """
    text = _verdict_sentence(
        verdict, missing, unexplained, where, fits, unmeasured, unit, ceiling, position_unit, rule
    )
    return text if given is None or given.source == "model" else f"{text} {given.sentence}"


def _verdict_sentence(
    verdict: str,
    missing: tuple[MissingEffect, ...],
    unexplained: Unexplained,
    where: str,
    fits: tuple[RecordingFit, ...],
    unmeasured: Unmeasured | None,
    unit: str | DisplayUnit,
    ceiling: Ceiling | None,
    position_unit: str | DisplayUnit,
    rule: Rule,
) -> str:
    if verdict == "adequate":
        if unmeasured is not None and unmeasured.of_applied > rule.limits.unmeasured:
            name, (force,) = in_unit(unit, unmeasured.force)
            return (
                "No effect of the catalogue is significant, but beside the base model the recordings need an "
                f"unmeasured force of {force:.2g} {name} rms "
                f"({100 * unmeasured.of_coulomb:.2g} % of Coulomb friction, "
                f"{100 * unmeasured.of_applied:.2g} % of the applied force), and nothing here explains that."
            )
        return "Nothing significant is missing: the base model leaves no misfit that is significant above the noise."
    held_out = _held_out(fits, unit, position_unit)
    if not missing:
        text = f"Something is missing that no effect of the catalogue explains. The mismatch is in: {where}."
        text = f"{text} {free_sentence(ceiling, unit)}".strip()
        return f"{text} {_carried(unexplained)} {held_out}".strip() if unexplained.carried_by else text
    named = "; ".join(_named(effect) for effect in missing)
    text = f"Missing from the base model: {named}. The mismatch is in: {where}. {held_out}"
    if verdict == "unknown":
        text += (
            f" The catalogue does not explain the remaining {100 * unexplained.share:.0f} % of the misfit."
        )
        if unexplained.carried_by:
            text += f" {_carried(unexplained)}"
    return f"{text} {free_sentence(ceiling, unit)}".strip()


def free_sentence(ceiling: Ceiling | None, unit: str | DisplayUnit) -> str:
    """What a free force explains, in the force `unit`; empty where the `ceiling` is not above the model."""
    if ceiling is None or not ceiling.above:
        return ""
    name, (force,) = in_unit(unit, ceiling.force)
    return (
        f"A force that is free in {ceiling.variable} predicts the held-out recordings significantly better: it is "
        f"{force:.2g} {name} rms ({100 * ceiling.of_coulomb:.2g} % of Coulomb friction, "
        f"{100 * ceiling.of_applied:.2g} % of the applied force) and removes {100 * ceiling.share_holdout:.0f} % of "
        "the misfit that is left there."
    )


def _carried(unexplained: Unexplained) -> str:
    return (
        f"A map of the missing force over {unexplained.carried_by} removes {100 * unexplained.explains:.0f} % of the "
        "misfit that is left on held-out recordings."
    )


def _named(effect: MissingEffect) -> str:
    others = [name for name in effect.effect_class if name != effect.effect]
    text = effect.sentence
    if others:
        text += f", which these recordings cannot distinguish from {' or '.join(others)}"
    return text


def _held_out(
    fits: tuple[RecordingFit, ...], force_unit: str | DisplayUnit, position_unit: str | DisplayUnit
) -> str:
    held_out = [fit for fit in fits if fit.role == "holdout"]
    if not held_out:
        return ""
    best = max(held_out, key=lambda f: f.prediction_rmse_base / max(f.prediction_rmse_extended, 1e-300))
    given = best.prediction_rmse_given
    unit, (base, extended, noise, own) = in_unit(
        force_unit if best.drive == "motion" else position_unit,
        best.prediction_rmse_base,
        best.prediction_rmse_extended,
        best.noise_floor,
        math.nan if given is None else given,
    )
    verb = (
        "falls" if best.prediction_rmse_extended < best.prediction_rmse_base else "does not fall: it changes"
    )
    return (
        f"On the held-out recording {best.name} the prediction error 0.1 s ahead {verb} from "
        f"{base:.3g} to {extended:.3g} {unit}".rstrip()
        + f" (noise {noise:.2g})"
        + ("." if given is None else f"; with your model as given it is {own:.3g}.")
    )
