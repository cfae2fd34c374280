"""Measured against base and extended model, held-out recordings first."""

from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis, RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report import figures
from frictionjax.report.format import quantities, quantity
from frictionjax.report.html import legend, pair, table, text
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import panels
from frictionjax.report.series import holdout_first, is_extended

_INTRO = (
    "Solid: predicted 0.1 s ahead from the samples measured until then. Dashed: free run from the first sample and "
    "the input. Shaded: twice the noise floor. Tinted, and shown in the close-up: where "
)
_IN_PART = (
    "The extended model has the named effects only: its remaining error is physics that is not modelled"
)


class Comparison(AbstractSection):
    """A table of errors, then for each recording the whole of it and a close-up."""

    title: ClassVar[str] = "Measured and modelled"

    def body(self, diagnosis: Diagnosis) -> str:
        recordings = holdout_first(diagnosis.recordings)
        if not recordings:
            return ""
        extended = is_extended(diagnosis)
        rows = [_row(recording, diagnosis.plant, extended) for recording in recordings]
        head = ("recording", "role", "noise floor", "prediction error", "free-run error")
        if any(recording.prediction_rmse_given is not None for recording in recordings):
            head += ("your model as given: prediction error", "free-run error")
        pictures = panels(recordings, diagnosis.plant, extended, figures.comparison)
        closer = "the extension improves the fit most" if extended else "the model fits worst"
        if extended and diagnosis.verdict == "unknown":
            closer += ". " + _IN_PART
        key = legend(extended, ("measured", "measured"))
        return f"{table(head, rows)}<p>{_INTRO}{closer}.</p>{key}{pictures}"


def _row(recording: RecordingFit, plant: Plant, extended: bool) -> tuple[str, ...]:
    _, unit, _ = figures.answer_of(recording, plant)

    def change(before: float, after: float) -> str:
        base, now = map(text, quantities([before, after], unit))
        return pair(base, now if extended else None)

    given = (recording.prediction_rmse_given, recording.free_run_rmse_given)
    return (
        text(recording.name),
        "held out" if recording.role == "holdout" else "fit",
        text(quantity(recording.noise_floor, unit)),
        change(recording.prediction_rmse_base, recording.prediction_rmse_extended),
        change(recording.free_run_rmse_base, recording.free_run_rmse_extended),
        *(text(quantity(error, unit)) for error in given if error is not None),
    )
