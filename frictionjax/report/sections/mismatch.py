"""The map of the base model's mismatch over regime, velocity, position, frequency and other axes."""

import math
from collections.abc import Iterable
from typing import ClassVar

from frictionjax.diagnosis.verdict import Diagnosis, MismatchBin, Within
from frictionjax.report.format import number, p_equals, percent, words
from frictionjax.report.html import gauge, legend, pair, text
from frictionjax.report.sections.base import AbstractSection

_AXES = {
    "direction": "direction of motion",
    "input": "size of the input",
    "since_reversal": "since the last reversal",
    "dwell": "time at rest before",
}
_MOST = 12  # bins of one axis that get a row each
_INTRO = (
    "Where the base model fails, before any effect is added. <b>Share</b>: a bin's part of the whole mismatch. "
    "<b>Excess</b>: power of the residual over its noise floor (the tick, at 1); four times the power is twice the "
    "error."
)


class Mismatch(AbstractSection):
    """For each axis a table of bins: a bar for the share, a logarithmic gauge for the excess before and after."""

    title: ClassVar[str] = "Where the base model fails"

    def body(self, diagnosis: Diagnosis) -> str:
        axes: dict[str, list[MismatchBin]] = {}
        for cell in diagnosis.mismatch:
            axes.setdefault(cell.axis, []).append(cell)
        if not axes:
            return ""
        after = any(math.isfinite(cell.excess_extended) for cell in diagnosis.mismatch)
        # One scale for all axes but frequency, where the excess is far larger in bins that the observer suppresses.
        wide = _highest(cell for name, cells in axes.items() if name != "frequency" for cell in cells)
        level = diagnosis.rule.place.significant
        tables = "".join(
            _axis(name, cells, after, _highest(cells) if name == "frequency" else wide, level)
            for name, cells in axes.items()
        )
        grey = ""
        if any(cell.p_value >= level for cell in diagnosis.mismatch):
            grey = f" Grey bins are not significant (family-wise p > {level:g})."
        parts = "".join(map(_part, diagnosis.within))
        parts = f'<ul class="within">{parts}</ul>' if parts else ""
        return f'<p>{_INTRO}{grey}</p>{parts}{legend(after, marks=True)}<div class="axes">{tables}</div>'


def _part(part: Within) -> str:
    many = "Only" if part.only else "Mostly"
    return (
        f"<li>{many} <b>{text(part.phrase)}</b>: in {text(part.given)}, this part has "
        f"{percent(part.share)} of the excess in {percent(part.samples)} of the samples; excess "
        f"{number(part.excess, 2)} against {number(part.excess_elsewhere, 2)} in the rest "
        f"({p_equals(part.p_value)}).</li>"
    )


def _highest(cells: Iterable[MismatchBin]) -> float:
    """Upper end of the scale of excesses."""
    return 1.5 * max([10.0, *(cell.excess for cell in cells if math.isfinite(cell.excess))])


def _axis(name: str, cells: list[MismatchBin], after: bool, high: float, level: float) -> str:
    # The strongest bins keep their natural order: a map is read along its axis.
    kept = sorted(range(len(cells)), key=lambda k: -_finite(cells[k].share))[:_MOST]
    # Bold: a share twice that of an even distribution over the bins; on short axes, 60 %.
    striking = 2.0 * sum(_finite(cell.share) for cell in cells) / len(cells) if len(cells) > 3 else 0.6
    rows = "".join(
        _row(cells[k], _finite(cells[k].share) >= striking, after, high, level) for k in sorted(kept)
    )
    if len(kept) < len(cells):
        rest = sum(_finite(cell.share) for k, cell in enumerate(cells) if k not in kept)
        rows += (
            f'<tr class="rest"><td colspan="4">{len(cells) - len(kept)} more bins: {percent(rest)}</td></tr>'
        )
    heading = words(_AXES.get(name, name)).capitalize()
    return (
        f'<div class="axis"><h3>{text(heading)}</h3><table><thead><tr><th scope="col"></th><th scope="col">share</th>'
        f'<th scope="col" colspan="2">excess</th></tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _row(cell: MismatchBin, striking: bool, after: bool, high: float, level: float) -> str:
    extended = cell.excess_extended if after and math.isfinite(cell.excess_extended) else None
    excess = pair(number(cell.excess, 2), None if extended is None else number(extended, 2))
    width = 100 * min(max(_finite(cell.share), 0.0), 1.0)
    css = "chance" if cell.p_value >= level else "striking" if striking else ""
    return (
        f'<tr class="{css}"><th scope="row">{text(cell.bin)}</th>'
        f'<td class="share"><span class="bar"><i style="width:{width:.1f}%"></i></span> {percent(cell.share)}</td>'
        f'<td class="scale">{gauge(cell.excess, extended, low=0.5, high=high, floor=1.0)}</td><td>{excess}</td></tr>'
    )


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0
