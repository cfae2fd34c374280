"""The parameters of both models with their standard errors."""

import math
from typing import ClassVar

from frictionjax.core import Estimate
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import DASH, estimate_text, number, percent, unit_text, words
from frictionjax.report.html import table, text
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import is_extended


class Parameters(AbstractSection):
    """One row for each parameter: base value, extended value, and the bias of the base value by the missing physics."""

    title: ClassVar[str] = "Parameters"

    def body(self, diagnosis: Diagnosis) -> str:
        if not diagnosis.base and not diagnosis.extended:
            return ""
        extended = is_extended(diagnosis) or diagnosis.extended != diagnosis.base
        names = [*diagnosis.base, *(name for name in diagnosis.extended if name not in diagnosis.base)]
        rows = [
            _row(name, diagnosis.base.get(name), diagnosis.extended.get(name), extended) for name in names
        ]
        head = ["parameter", "unit", "base model"]
        if extended:
            head += ["extended model", "change"]
        note = (
            "" if not extended else "; the change is in per cent of the extended value and in standard errors"
        )
        return f"<p>Value ± standard error{note}.</p>{table(head, rows)}"


def _row(name: str, base: Estimate | None, after: Estimate | None, extended: bool) -> list[str]:
    known = base or after
    unit = unit_text(known.unit) if known else ""
    row = [f"<var>{text(words(name))}</var>", text(unit or "1"), _value(base)]
    return [*row, _value(after), _change(base, after)] if extended else row


def _value(estimate: Estimate | None) -> str:
    if estimate is None:
        return DASH
    if not estimate.identified or not math.isfinite(estimate.stderr):
        return f"{number(estimate.value)} <em>not determined by these recordings</em>"
    return text(estimate_text(estimate))


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
