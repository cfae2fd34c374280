"""The second and the third sentence of the report: how much better the model is, and what to do next."""

import math

import numpy as np

from frictionjax.core.quantities import DisplayUnit, times
from frictionjax.diagnosis.findings.summary import free_sentence
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import number, percent, quantities, words
from frictionjax.report.series import is_extended

_LISTED = 3  # effects that a sentence names


def improvement(diagnosis: Diagnosis) -> str:
    """How well the models predict, in position, and how much force they lack, with units; on the held-out recordings
    where there are any."""
    judged = [one for one in diagnosis.recordings if one.role == "holdout"] or list(diagnosis.recordings)
    if not judged:
        return ""
    on = "On the held-out recordings" if judged[0].role == "holdout" else "On the recordings"
    plant, imposed = diagnosis.plant, judged[0].drive == "motion"
    unit = plant.shown_force if imposed else plant.shown_position
    before, after = (_rms(judged, f"prediction_rmse_{model}") for model in ("base", "extended"))
    lacks = _lacking(judged, "base"), _lacking(judged, "extended")
    of_what = "the friction force" if imposed else "the position"
    floors = _over_noise(judged, is_extended(diagnosis))
    if not is_extended(diagnosis):
        (error,), (force,) = quantities([before], unit, 2), quantities([lacks[0]], plant.shown_force, 2)
        return (
            f"{on} the base model predicts {of_what} 0.1 s ahead to {error} rms{_in_brackets(floors)}, and would need "
            f"another {force} rms of force to follow them exactly."
        )
    was, now = quantities([before, after], unit, 2)
    force, left = quantities(lacks, plant.shown_force, 2)
    better = f"{times(before / after)} better" if 0 < after < before else ""
    return (
        f"{on} the model with it predicts {of_what} 0.1 s ahead to {now} rms instead of "
        f"{was}{_in_brackets(better, floors)}, and the force that it lacks is {left} rms instead of {force}."
    )


def over_noise(recording: RecordingFit, extended: bool) -> float:
    """The error of the last model 0.1 s ahead over the noise floor of a `recording`; not a number where no floor is
    known.

    **Arguments:** `extended`: whether the last model is the extended one.
    """
    error = recording.prediction_rmse_extended if extended else recording.prediction_rmse_base
    return error / recording.noise_floor if recording.noise_floor > 0.0 else math.nan


def _over_noise(recordings: list[RecordingFit], extended: bool) -> str:
    """The largest error over the noise floor of some `recordings`, as on their cards; empty where no floor is known."""
    found = [ratio for one in recordings if math.isfinite(ratio := over_noise(one, extended))]
    return f"{'up to ' * (len(found) > 1)}{number(max(found), 2)} × noise floor" if found else ""


def _in_brackets(*remarks: str) -> str:
    said = [remark for remark in remarks if remark]
    return f" ({', '.join(said)})" if said else ""


def next_step(diagnosis: Diagnosis) -> str:
    """What to do, in a sentence or two; empty where the summary says it: when nothing was diagnosed."""
    if not diagnosis.was_diagnosed:
        return ""
    open_choice = [found for found in diagnosis.missing if len(found.effect_class) > 1]
    if open_choice:
        found = open_choice[0]
        others = " or ".join(words(name) for name in found.effect_class)
        if found.next_experiment is not None:
            return f"To decide between {others}: {found.next_experiment.sentence}"
        if found.split_by:
            return f"To decide between {others}, record this and diagnose again: {found.split_by}."
    names = " and ".join(found.sentence or words(found.effect) for found in diagnosis.missing)
    if diagnosis.verdict == "named":
        changed = _most_changed(diagnosis)
        return f"Add {names} to your model, with the friction parameters of the extended model{changed}."
    place = diagnosis.unexplained.where
    where = f" in {place}" if place else ""
    if diagnosis.verdict == "unknown":
        first = f"Add {names}, then look" if names else "Look"
        return (
            f"{first} for a cause{where}: record the machine there again, with one condition changed at a time, and "
            "describe the cause as an effect of your own where the catalogue has none."
        )
    untested = [one for one in diagnosis.candidates if not one.tested]
    if not untested:
        return "Use the base model as it is."
    some = ", ".join(words(one.effect) for one in untested[:_LISTED])
    more = f" and {len(untested) - _LISTED} others" if len(untested) > _LISTED else ""
    return (
        f"Use the base model as it is; these recordings cannot show {some}{more}: the table of candidates says what to "
        "record for that."
    )


def remainder(diagnosis: Diagnosis) -> str:
    """What no effect of the catalogue explains, in a sentence; empty where that is not significant."""
    left = diagnosis.unexplained
    if not left.present or not diagnosis.was_diagnosed:
        return ""
    where = f", most of it in {left.where}" if left.where else ""
    carried = (
        f" A map of the missing force over {left.carried_by} removes {percent(left.explains)} of what is left on "
        "held-out recordings."
        if left.carried_by
        else ""
    )
    free = free_sentence(diagnosis.ceiling, diagnosis.plant.shown_force)
    carried += f" {free}" if free else ""
    share = percent(left.share)
    if diagnosis.verdict == "named":
        return (
            f"The named physics explains all but {share} of the misfit of the base model{where}. No effect of the "
            f"catalogue explains the rest, which is small enough to leave the name as it is.{carried}"
        )
    return f"No effect of the catalogue explains {share} of the misfit of the base model{where}.{carried}"


def badge(diagnosis: Diagnosis) -> str:
    """The verdict in a few words, in agreement with `remainder`; and, above cards that say how far the last model is
    from the noise 0.1 s ahead, the largest of their numbers: what leaves no significant misfit may still be far from
    it, as errors grow along a prediction."""
    if not diagnosis.was_diagnosed:
        return "Not diagnosed: the base model does not fit these recordings"
    if diagnosis.verdict == "adequate":
        return f"Adequate: no missing physics is significant{_ahead(diagnosis)}"
    if diagnosis.verdict == "unknown":
        if diagnosis.missing:
            return "Unknown: an effect is named, but no effect of the catalogue explains the rest"
        return "Unknown: physics is missing that no effect of the catalogue explains"
    if diagnosis.unexplained.present:
        return f"Named: all but {percent(diagnosis.unexplained.share)} of the misfit is explained{_ahead(diagnosis)}"
    return f"Named: no significant misfit remains{_ahead(diagnosis)}"


def _ahead(diagnosis: Diagnosis) -> str:
    """How far the last model is from the noise on the held-out recordings, as the end of a badge."""
    held_out = [one for one in diagnosis.recordings if one.role == "holdout"]
    floors = _over_noise(held_out, is_extended(diagnosis))
    return f"; 0.1 s ahead, the held-out error is {floors}" if floors else ""


def _most_changed(diagnosis: Diagnosis) -> str:
    """The base parameter that changes most by the extension, over its own size."""
    changes = {
        name: (diagnosis.extended[name].value - before.value) / before.value
        for name, before in diagnosis.base.items()
        if name in diagnosis.extended
        and before.value
        and before.identified
        and diagnosis.extended[name].identified
    }
    changes = {name: change for name, change in changes.items() if math.isfinite(change) and change}
    if not changes:
        return ""
    name = max(changes, key=lambda one: abs(changes[one]))
    unit = diagnosis.plant.displayed(diagnosis.extended[name].unit)
    before, after = quantities([diagnosis.base[name].value, diagnosis.extended[name].value], unit)
    return f" ({words(name)} changes most, from {before} to {after})"


def _rms(recordings: list[RecordingFit], name: str) -> float:
    return float(np.sqrt(np.mean([getattr(one, name) ** 2 for one in recordings])))


def _lacking(recordings: list[RecordingFit], model: str) -> float:
    """The force that a `model` lacks, root mean square, each recording with the same weight; not a number where a
    result of an earlier version does not say."""
    found = [getattr(one, f"unmeasured_{model}") for one in recordings]
    return math.nan if None in found else math.sqrt(float(np.mean([one.force**2 for one in found])))


def force_lacking(recording: RecordingFit, unit: str | DisplayUnit, extended: bool) -> tuple[str, str | None]:
    """The force that base and extended model lack in one recording, root mean square, as text in the force `unit`."""
    before, after = quantities([_lacking([recording], model) for model in ("base", "extended")], unit, 2)
    return before, after if extended else None
