"""The ceiling: what is named against what any force would explain, on each held-out recording."""

from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.findings.summary import free_sentence
from frictionjax.diagnosis.recording_fit import Horizon, RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis, OneStep
from frictionjax.report.bars import BarGroup, Bars
from frictionjax.report.figures import answer_of
from frictionjax.report.format import number
from frictionjax.report.html import figure, legend
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.sections.panels import MOST
from frictionjax.report.series import is_extended
from frictionjax.report.template import fill

_INTRO = (
    "One step ahead: the innovations of the base model, {}and of the {} model with a free force beside it, any "
    "function of position, velocity, deflection of the bristle, distance since a reversal, last rest, input and time. "
    "That is the ceiling: how far a better friction model could go. Innovations count as in the verdict, where a few "
    "large ones do not rule. Further ahead all errors count; the free force is known along the measured motion alone, "
    "and has no bar there."
)
_NOT_ABOVE = (
    "No free force predicts the held-out recordings significantly better than the {} model: what is left is noise, or "
    "depends on more of the past, as a delay and creep do."
)
_CAPTION = "{}: errors on this held-out recording, and what a free force leaves one step ahead"
_FREE = "{} model and a free force"
_LONG = 1.5  # times 0.1 s: from here on a horizon is another one than that of 0.1 s


class CeilingsSection(AbstractSection):
    """A sentence on the free force, and bars for each held-out recording; empty where no force was tried."""

    title: ClassVar[str] = "What any force could explain"

    def body(self, diagnosis: Diagnosis) -> Markup:
        ceiling, extended = diagnosis.ceiling, is_extended(diagnosis)
        fits = {one.name: one for one in diagnosis.recordings if one.role == "holdout"}
        if ceiling is None or not any(one.recording in fits for one in ceiling.recordings):
            return Markup("")
        last = "extended" if extended else "base"
        said = free_sentence(ceiling, diagnosis.plant.shown_force) or _NOT_ABOVE.format(last)
        drawn = [(one, fits[one.recording]) for one in ceiling.recordings if one.recording in fits][:MOST]
        pictures = [
            figure(lambda one=one, fit=fit: bars_of(one, fit, diagnosis, extended), _CAPTION.format(fit.name))
            for one, fit in drawn
        ]
        groups = [{"title": "", "held_out": True, "figures": pictures}]
        key = legend(extended, ("free", _FREE.format(last)))
        intro = [said, _INTRO.format("of the extended model, " if extended else "", last)]
        return fill("charts.html.j2", intro=intro, legend=key, groups=groups, notes=[])


def bars_of(one: OneStep, fit: RecordingFit, diagnosis: Diagnosis, extended: bool) -> Bars:
    """The errors of a held-out recording one step ahead, with the ceiling, 0.1 s ahead, and at the longest horizon at
    which the last model predicts better than that the machine stays where it is."""
    _, unit, _ = answer_of(fit, diagnosis.plant)

    def models(base: float, last: float) -> tuple[tuple[str, str, float], ...]:
        both = (("base", "base model", base), ("extended", "extended model", last))
        return both[: 2 if extended else 1]

    free = ("free", _FREE.format("extended" if extended else "base"), one.free * fit.one_sample_floor)
    steps = models(one.base * fit.one_sample_floor, one.model * fit.one_sample_floor)
    groups = [
        BarGroup("one step ahead, robust rms", (*steps, free)),
        BarGroup("0.1 s ahead, rms", models(fit.prediction_rmse_base, fit.prediction_rmse_extended)),
    ]
    longest = _longest(fit, extended)
    if longest is not None:
        title = f"{number(longest.seconds, 2)} s ahead, rms (the longest that is better than standstill)"
        groups.append(BarGroup(title, models(longest.base, longest.extended)))
    return Bars("error", unit, tuple(groups), fit.one_sample_floor)


def _longest(fit: RecordingFit, extended: bool) -> Horizon | None:
    """The longest horizon beyond 0.1 s at which the last model is better than standstill; None where there is none."""
    useful = [
        one
        for one in fit.horizons
        if one.seconds > 0.1 * _LONG and (one.extended if extended else one.base) < one.standstill
    ]
    return max(useful, key=lambda one: one.seconds, default=None)
