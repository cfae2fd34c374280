"""The summary, the verdict, and the prediction errors on held-out recordings."""

import math
import re
from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis, RecordingFit
from frictionjax.report.figures import answer_of
from frictionjax.report.format import number, quantities, quantity
from frictionjax.report.html import gauge, pair, text
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import is_extended

_BADGES = {
    "adequate": "Adequate: no missing physics is significant",
    "named": "Named: the missing physics is identified and modelled",
    "unknown": "Unknown: physics is missing that no effect of the catalogue explains",
}
_NOT_DIAGNOSED = "Not diagnosed: the base model does not fit these recordings"
_IN_PART = "Unknown: an effect is named, but no effect of the catalogue explains the rest"


class Headline(AbstractSection):
    """The summary; then the badge, the case, and one card for each held-out recording."""

    title: ClassVar[str] = ""

    def body(self, diagnosis: Diagnosis) -> str:
        first, *rest = re.split(r"(?<=[.!?])\s+(?=[A-Z])", diagnosis.summary, maxsplit=1)
        lead = f'<p class="lead">{text(rest[0])}</p>' if rest else ""
        held_out = [recording for recording in diagnosis.recordings if recording.role == "holdout"]
        fitted = len(diagnosis.recordings) - len(held_out)
        plural = "s" * (fitted != 1)
        facts = [f"case {diagnosis.case}", f"{fitted} recording{plural} to fit, {len(held_out)} held out"]
        if "total" in diagnosis.seconds:
            facts.append(f"{number(diagnosis.seconds['total'])} s of computing")
        extended = is_extended(diagnosis)
        cards = "".join(_card(recording, diagnosis, extended) for recording in held_out)
        if not cards:
            cards = (
                '<p class="note">No recording was held out, so nothing here was verified on other data.</p>'
            )
        badge = _BADGES[diagnosis.verdict]
        if diagnosis.verdict == "unknown" and diagnosis.missing:
            badge = _IN_PART
        elif not diagnosis.was_diagnosed:
            badge = _NOT_DIAGNOSED
        return (
            f'<h1>{text(first)}</h1>{lead}<p class="byline"><span class="badge {diagnosis.verdict}">'
            f"{text(badge)}</span> {text(' · '.join(facts))}</p>"
            f'<div class="cards">{cards}</div>'
        )


def _card(recording: RecordingFit, diagnosis: Diagnosis, extended: bool) -> str:
    _, unit, _ = answer_of(recording, diagnosis.plant)
    base, after, floor = (
        recording.prediction_rmse_base,
        recording.prediction_rmse_extended,
        recording.noise_floor,
    )
    before, now = map(text, quantities([base, after], unit, 2))
    values = pair(before, now if extended else None)
    best = after if extended else base
    remarks = []
    if extended and after > 0 and math.isfinite(base / after):
        remarks.append(f"{number(base / after, 2)} times smaller")
    if floor > 0 and math.isfinite(best / floor):
        remarks.append(f"{number(best / floor, 2)} × noise floor ({quantity(floor, unit, 2)})")
    sizes = [size for size in (base, after, floor) if math.isfinite(size) and size > 0] or [1.0]
    scale = gauge(base, after if extended else None, low=min(sizes) / 1.5, high=max(sizes) * 1.5, floor=floor)
    return (
        f'<div class="card"><p class="name">{text(recording.name)} <span class="tag">held out</span></p>'
        f'<p class="figure">{values}</p>{scale}'
        f"<p>rms error of predicting 0.1 s ahead{text('; ' + ', '.join(remarks) if remarks else '')}</p></div>"
    )
