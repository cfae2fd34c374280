"""What is missing, how much better the model is with it, what to do next; the verdict; the held-out errors."""

import math
import re
from typing import Any, ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.figures import answer_of
from frictionjax.report.format import number, quantities, quantity
from frictionjax.report.html import gauge, pair
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sentences import badge, force_lacking, improvement, next_step, over_noise
from frictionjax.report.series import is_extended
from frictionjax.report.template import fill


class HeadlineSection(AbstractSection):
    """Three sentences; then the badge, the case, what limits the reading, and one card for each held-out recording."""

    title: ClassVar[str] = ""

    def body(self, diagnosis: Diagnosis) -> Markup:
        first, *rest = re.split(r"(?<=[.!?])\s+(?=[A-Z])", diagnosis.summary, maxsplit=1)
        held_out = [recording for recording in diagnosis.recordings if recording.role == "holdout"]
        fitted = len(diagnosis.recordings) - len(held_out)
        facts = [
            f"case {diagnosis.case}",
            f"{fitted} recording{'s' * (fitted != 1)} to fit, {len(held_out)} held out",
        ]
        if "total" in diagnosis.seconds:
            facts.append(f"{number(diagnosis.seconds['total'])} s of computing")
        extended = is_extended(diagnosis)
        # Where nothing was diagnosed the summary says what to correct, and nothing else is to be read before that.
        lead = [improvement(diagnosis)] if diagnosis.was_diagnosed else rest
        if diagnosis.given is not None and diagnosis.was_diagnosed:
            lead.append(diagnosis.given.sentence)
        return fill(
            "headline.html.j2",
            first=first,
            lead=[sentence for sentence in lead if sentence],
            next=next_step(diagnosis),
            verdict=diagnosis.verdict,
            badge=badge(diagnosis),
            facts=facts,
            warnings=limiting(diagnosis),
            cards=[_card(recording, diagnosis, extended) for recording in held_out],
        )


def limiting(diagnosis: Diagnosis) -> list[str]:
    """The warnings that change how the result is to be read: those about the models; those about single recordings,
    which were put right when these were read, only where nothing was diagnosed."""
    if not diagnosis.was_diagnosed:
        return list(diagnosis.warnings)
    names = tuple(f"{recording.name}: " for recording in diagnosis.recordings)
    return [warning for warning in diagnosis.warnings if not warning.startswith(names)]


def _card(recording: RecordingFit, diagnosis: Diagnosis, extended: bool) -> dict[str, Any]:
    _, unit, _ = answer_of(recording, diagnosis.plant)
    base, after, floor = (
        recording.prediction_rmse_base,
        recording.prediction_rmse_extended,
        recording.noise_floor,
    )
    before, now = quantities([base, after], unit, 2)
    remarks = []
    if extended and after > 0 and math.isfinite(base / after):
        remarks.append(f"{number(base / after, 2)} times smaller")
    if math.isfinite(ratio := over_noise(recording, extended)):
        remarks.append(f"{number(ratio, 2)} × noise floor ({quantity(floor, unit, 2)})")
    sizes = [size for size in (base, after, floor) if math.isfinite(size) and size > 0] or [1.0]
    ends = {"low": min(sizes) / 1.5, "high": max(sizes) * 1.5}
    return {
        "name": recording.name,
        "errors": pair(before, now if extended else None),
        "scale": gauge(base, after if extended else None, floor=floor, **ends),
        "remarks": ", ".join(remarks),
        "force": pair(*force_lacking(recording, diagnosis.plant.shown_force, extended)),
    }
