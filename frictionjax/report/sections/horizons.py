"""How far base and extended model are off at each horizon, and the force that each lacks, for each recording."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.core.quantities import DisplayUnit
from frictionjax.diagnosis.recording_fit import Horizon, RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.recordings import Plant
from frictionjax.report import figures
from frictionjax.report.format import percent, quantities
from frictionjax.report.html import Cell, pair, table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import holdout_first, is_extended
from frictionjax.report.template import fill

_ERRORS = (
    "Root mean square error of the predicted position, by how far ahead it is predicted, from the samples measured "
    "until then: over one sample the sensor's noise dominates, over the whole recording, from its first sample, small "
    "errors add up. Behind each, in brackets, the error of predicting that the machine stays where it is: a model "
    "that is worse than that says nothing at this horizon."
)
_FORCE = (
    "The force that each model lacks: root mean square of the residual force above what sensor noise makes of it, and "
    "as part of the applied force."
)


class HorizonsSection(AbstractSection):
    """A table of the errors at each horizon, and of the force that is lacking."""

    title: ClassVar[str] = "Errors by horizon, and the force that is lacking"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = holdout_first(diagnosis.recordings)
        extended, sentences = is_extended(diagnosis), []
        horizons = any(recording.horizons for recording in recordings)
        lacking = any(recording.unmeasured_base is not None for recording in recordings)
        if not horizons and not lacking:
            return Markup("")
        head = ["recording"]
        # All recordings have the shortest and the longest one, each at its own.
        between = sorted({_seconds(one) for recording in recordings for one in recording.horizons[1:-1]})
        if horizons:
            sentences.append(_ERRORS)
            head += ["one sample ahead", *(f"{seconds:g} s ahead" for seconds in between), "whole recording"]
        if lacking:
            sentences.append(_FORCE)
            head += ["lacking force", "of the applied force"]
        rows = [
            _row(one, diagnosis.plant, extended, between if horizons else None, lacking) for one in recordings
        ]
        return fill("prose.html.j2", sentences=sentences, below=table(head, rows))


def _row(
    recording: RecordingFit, plant: Plant, extended: bool, between: list[float] | None, lacking: bool
) -> list[Cell]:
    """The cells of a `recording`, with those of its horizons, and of those `between` the first and the last, unless
    that is None."""
    row: list[Cell] = [recording.name]
    if between is not None:
        _, unit, _ = figures.answer_of(recording, plant)
        own = [_change(one, unit, extended) for one in recording.horizons]
        middle = dict(zip(map(_seconds, recording.horizons[1:-1]), own[1:-1], strict=True))
        row += [*(own[:1] or ["–"]), *(middle.get(seconds, "–") for seconds in between), *(own[-1:] or ["–"])]
    base, after = recording.unmeasured_base, recording.unmeasured_extended
    if base is not None and after is not None:
        forces = quantities([base.force, after.force], plant.shown_force)
        parts = (percent(base.of_applied), percent(after.of_applied))
        row += [pair(first, then if extended else None) for first, then in (forces, parts)]
    elif lacking:
        row += ["–", "–"]
    return row


def _seconds(horizon: Horizon) -> float:
    """Its length to a hundredth of a second: that of 0.1 s is a whole number of samples."""
    return round(horizon.seconds, 2)


def _change(horizon: Horizon, unit: str | DisplayUnit, extended: bool) -> Markup:
    base, now, still = quantities([horizon.base, horizon.extended, horizon.standstill], unit)
    return pair(base, now if extended else None) + Markup('<br><span class="still">({})</span>').format(still)
