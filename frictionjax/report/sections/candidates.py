"""Every effect of the catalogue: p-value, size, gain and outcome."""

import math
from typing import ClassVar

from frictionjax.diagnosis.verdict import Candidate, Diagnosis
from frictionjax.physics.effects.catalogue import catalogue
from frictionjax.report.format import DASH, p_value, percent, quantity, words
from frictionjax.report.html import table, text
from frictionjax.report.sections.base import AbstractSection

_INTRO = (
    "<b>p</b>: p-value of the model without the effect; for a named effect, with the effects named before it. "
    "<b>One step</b>: size of the effect before any refit. <b>Gain</b>: share of the mismatch that a refit with the "
    "effect explains. <b>Detectable</b>: the smallest size that these recordings would show."
)


class Candidates(AbstractSection):
    """One row for each effect, smallest p-value first; those that could not be tested last, with the reason."""

    title: ClassVar[str] = "Candidates"

    def body(self, diagnosis: Diagnosis) -> str:
        candidates = sorted(diagnosis.candidates, key=_order)
        if not candidates:
            return ""
        named = {found.effect for found in diagnosis.missing}
        alike = {name for found in diagnosis.missing for name in found.effect_class} - named
        meanings = {name: forms[0].about.sentence for name, forms in catalogue().items()}
        head = ("effect", "p", "one step", "gain on fit", "gain held out", "detectable", "outcome")
        rows = [_row(candidate, meanings.get(candidate.effect, ""), named, alike) for candidate in candidates]
        classes = ["named" if c.effect in named else "" if c.tested else "untested" for c in candidates]
        return f"<p>{_INTRO}</p>{table(head, rows, classes=classes)}"


def _order(candidate: Candidate) -> tuple[bool, float, str]:
    p = candidate.p_value if math.isfinite(candidate.p_value) else math.inf
    return not candidate.tested, p, candidate.effect


def _row(candidate: Candidate, meaning: str, named: set[str], alike: set[str]) -> tuple[str, ...]:
    tag = ""
    if candidate.effect in named:
        tag = ' <span class="tag">named</span>'
    elif candidate.effect in alike:
        tag = ' <span class="tag">same class</span>'
    if not candidate.tested:
        tag = ' <span class="tag">not tested</span>'
    small = f"<small>{text(meaning)}</small>" if meaning else ""
    return (
        f"{text(words(candidate.effect))}{tag}{small}",
        text(p_value(candidate.p_value)),
        _sizes(candidate.one_step, candidate.units),
        percent(candidate.gain_fit),
        percent(candidate.gain_holdout),
        _sizes(candidate.minimum_detectable, candidate.units),
        text(candidate.reason),
    )


def _sizes(sizes: dict[str, float], units: dict[str, str]) -> str:
    lines = [
        f"{text(words(name))} {text(quantity(size, units.get(name, '1')))}" for name, size in sizes.items()
    ]
    return "<br>".join(lines) or DASH
