"""Measured against base and extended model, held-out recordings first."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.recordings import Plant
from frictionjax.report import figures
from frictionjax.report.format import quantities, quantity
from frictionjax.report.html import Cell, legend, pair, table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import panels
from frictionjax.report.series import holdout_first, is_extended
from frictionjax.report.template import fill

_INTRO = (
    "Above, solid: predicted 0.1 s ahead from the samples measured until then; dashed: free run from the first sample "
    "and the input. In the middle: the error of the prediction, with twice the noise floor shaded. Tinted, and shown "
    "in the close-up: where "
)
_IN_PART = (
    "The extended model has the named effects only: its remaining error is physics that is not modelled"
)


class ComparisonSection(AbstractSection):
    """For each recording the whole of it and a close-up."""

    title: ClassVar[str] = "Measured and modelled"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return Markup("")
        extended = is_extended(diagnosis)
        groups, notes = panels(recordings, diagnosis.plant, extended, figures.comparison)
        closer = "the extension improves the fit most" if extended else "the model fits worst"
        if extended and diagnosis.verdict == "unknown":
            closer += ". " + _IN_PART
        own = [("given", "your simulation as given")] if diagnosis.given is not None else []
        key = legend(extended, ("measured", "measured"), ("band", "± 2 noise floors"), *own)
        return fill("charts.html.j2", intro=[f"{_INTRO}{closer}."], legend=key, groups=groups, notes=notes)


class ErrorsSection(AbstractSection):
    """A table of the errors on each recording."""

    title: ClassVar[str] = "Errors"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return Markup("")
        extended = is_extended(diagnosis)
        head = ["recording", "role", "noise floor", "prediction error", "free-run error"]
        said = ["Root mean square: of predicting 0.1 s ahead, and of a free run from the first sample."]
        if any(recording.free_run_rmse_given is not None for recording in recordings):
            column = diagnosis.given is not None and diagnosis.given.source == "column"
            whose = "your simulation as given" if column else "your model as given"
            head += ["error of the motion over 0.1 s in the free run", f"{whose}: free-run error"]
            head += [f"{whose}: error of the motion over 0.1 s"]
            said.append(_MOTION)
        if any(recording.prediction_rmse_given is not None for recording in recordings):
            head.append("your model as given: prediction error")
        rows = [_row(recording, diagnosis.plant, extended, len(head)) for recording in recordings]
        return fill("prose.html.j2", sentences=said, below=table(head, rows))


_MOTION = (
    "The motion over 0.1 s is what a free run moves in that time, from the measured position and with its own "
    "velocity: no measured sample corrects it, so that simulations and models are compared alike."
)


def _row(recording: RecordingFit, plant: Plant, extended: bool, length: int) -> list[Cell]:
    _, unit, _ = figures.answer_of(recording, plant)

    def change(before: float, after: float) -> Markup:
        base, now = quantities([before, after], unit)
        return pair(base, now if extended else None)

    row: list[Cell] = [
        recording.name,
        "held out" if recording.role == "holdout" else "fit",
        quantity(recording.noise_floor, unit),
        change(recording.prediction_rmse_base, recording.prediction_rmse_extended),
        change(recording.free_run_rmse_base, recording.free_run_rmse_extended),
    ]
    if length == len(row):
        return row
    row.append(
        change(*(_known(getattr(recording, f"increment_rmse_{model}")) for model in ("base", "extended")))
    )
    own = (recording.free_run_rmse_given, recording.increment_rmse_given, recording.prediction_rmse_given)
    row += [quantity(_known(error), unit) for error in own[: length - len(row)]]
    return row


def _known(error: float | None) -> float:
    """The `error`; NaN, which is shown as a dash, where there is none."""
    return float("nan") if error is None else error
