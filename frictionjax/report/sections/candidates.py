"""Every effect of the catalogue: p-value, size, gain and outcome."""

import math
from typing import ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Candidate, Diagnosis
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Plant
from frictionjax.report.format import DASH, p_value, percent, quantity, words
from frictionjax.report.html import Cell, table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.template import fill

_INTRO = (
    "<b>p</b>: p-value of the model without the effect; for a named effect, with the effects named before it. "
    "<b>One step</b>: size of the effect before any refit. <b>Gain</b>: share of the mismatch that a refit with the "
    "effect explains. <b>Detectable</b>: the smallest size that these recordings would show."
)
_HEAD = ("effect", "p", "one step", "gain on fit", "gain held out", "detectable", "outcome")


class CandidatesSection(AbstractSection):
    """One row for each effect, smallest p-value first; those that could not be tested last, with the reason."""

    title: ClassVar[str] = "Candidates"

    def body(self, diagnosis: Diagnosis) -> Markup:
        candidates = sorted(diagnosis.candidates, key=_order)
        if not candidates:
            return Markup("")
        named = {found.effect for found in diagnosis.missing}
        alike = {name for found in diagnosis.missing for name in found.effect_class} - named
        meanings = {name: forms[0].about.sentence for name, forms in catalogue().items()}
        rows = [
            _row(candidate, diagnosis.plant, meanings.get(candidate.effect, ""), named, alike)
            for candidate in candidates
        ]
        classes = ["named" if c.effect in named else "" if c.tested else "untested" for c in candidates]
        return fill("prose.html.j2", sentences=[Markup(_INTRO)], below=table(_HEAD, rows, classes=classes))


def _order(candidate: Candidate) -> tuple[bool, float, str]:
    p = candidate.p_value if math.isfinite(candidate.p_value) else math.inf
    return not candidate.tested, p, candidate.effect


def _row(
    candidate: Candidate, plant: Plant, meaning: str, named: set[str], alike: set[str]
) -> tuple[Cell, ...]:
    tag = ""
    if candidate.effect in named:
        tag = "named"
    elif candidate.effect in alike:
        tag = "same class"
    if not candidate.tested:
        tag = "not tested"
    mark = Markup(' <span class="tag">{}</span>').format(tag) if tag else ""
    small = Markup("<small>{}</small>").format(meaning) if meaning else ""
    return (
        Markup("{}{}{}").format(words(candidate.effect), mark, small),
        p_value(candidate.p_value),
        _sizes(candidate.one_step, candidate.units, plant),
        percent(candidate.gain_fit),
        percent(candidate.gain_holdout),
        _sizes(candidate.minimum_detectable, candidate.units, plant),
        candidate.reason,
    )


def _sizes(sizes: dict[str, float], units: dict[str, str], plant: Plant) -> Cell:
    lines = [
        f"{words(name)} {quantity(size, plant.displayed(units.get(name, '1')))}"
        for name, size in sizes.items()
    ]
    return Markup("<br>").join(lines) or DASH
