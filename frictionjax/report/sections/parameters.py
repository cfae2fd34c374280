"""The parameters of both models with their meanings and standard errors."""

import math
from typing import ClassVar

from markupsafe import Markup

from frictionjax.core import Estimate
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import DASH, estimate_text, number, percent, shown_estimates, unit_text, words
from frictionjax.report.html import Cell, table
from frictionjax.report.meanings import meaning_of, with_amplitudes
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import is_extended
from frictionjax.report.template import fill


class ParametersSection(AbstractSection):
    """One row for each parameter: meaning, base value, extended value, and the bias of the base value by the missing
    physics; a wave by its amplitude and phase."""

    title: ClassVar[str] = "Parameters"

    def body(self, diagnosis: Diagnosis) -> Markup:
        if not diagnosis.base and not diagnosis.extended:
            return Markup("")
        extended = is_extended(diagnosis) or diagnosis.extended != diagnosis.base
        before, after = (
            with_amplitudes(shown_estimates(model, diagnosis.plant))
            for model in (diagnosis.base, diagnosis.extended)
        )
        names = [*before, *(name for name in after if name not in before)]
        rows = [_row(name, before.get(name), after.get(name), extended) for name in names]
        head = ["parameter", "unit", "base model"]
        if extended:
            head += ["extended model", "change"]
        note = "; the change is in per cent of the extended value and in standard errors" if extended else ""
        return fill("prose.html.j2", sentences=[f"Value ± standard error{note}."], below=table(head, rows))


def _row(name: str, base: Estimate | None, after: Estimate | None, extended: bool) -> list[Cell]:
    known = base or after
    unit = unit_text(known.unit) if known else ""
    meaning = meaning_of(name)
    small = Markup("<small>{}</small>").format(meaning) if meaning else ""
    row: list[Cell] = [Markup("<var>{}</var>{}").format(words(name), small), unit or "1", _value(base)]
    return [*row, _value(after), _change(base, after)] if extended else row


def _value(estimate: Estimate | None) -> Cell:
    if estimate is None:
        return DASH
    if not estimate.identified or not math.isfinite(estimate.stderr):
        return Markup("{} <em>not determined by these recordings</em>").format(number(estimate.value))
    return estimate_text(estimate)


def _change(base: Estimate | None, after: Estimate | None) -> str:
    if base is None or after is None or not (base.identified and after.identified):
        return DASH
    step = after.value - base.value
    # The two fits share their data, so their errors do not add: the larger one is the scale of the change.
    error = max(base.stderr, after.stderr)
    if abs(step) <= error:
        return "within one standard error"
    parts = [f"{'+' if step > 0 else ''}{percent(step / abs(after.value))}"] if after.value else []
    if math.isfinite(error) and error > 0:
        parts.append(f"{number(abs(step) / error, 2)} standard errors")
    return ", ".join(parts) or DASH
