"""The map of the base model's mismatch over regime, velocity, position, frequency and other axes."""

import math
from collections.abc import Iterable
from typing import Any, ClassVar

from markupsafe import Markup

from frictionjax.diagnosis.verdict import Diagnosis, MismatchBin, Within
from frictionjax.report.format import number, p_equals, percent, words
from frictionjax.report.html import MODELS, gauge, legend, pair
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.template import fill

_AXES = {
    "direction": "direction of motion",
    "input": "size of the input",
    "since_reversal": "since the last reversal",
    "dwell": "time at rest before",
}
_BASE_FAILS = "Where the base model fails, before any effect is added."
_GIVEN_MISSES = (
    "Where your simulation misses, as an observer shows it that has the acceleration from it, and position and "
    "velocity from the measurement: an offset or a constant drift does not count. A simulation that has lost the "
    "motion misses wherever the machine then is."
)
_MOST = 12  # bins of one axis that get a row each


class MismatchSection(AbstractSection):
    """For each axis a table of bins: a bar for the share, a logarithmic gauge for the excess before and after."""

    title: ClassVar[str] = "Where the base model fails"

    def body(self, diagnosis: Diagnosis) -> Markup:
        level = diagnosis.rule.place.significant
        return _map(diagnosis.mismatch, level, _BASE_FAILS, MODELS, diagnosis.within)


class SimulationMissesSection(AbstractSection):
    """How far the user's own simulation is from the recordings, and the same map of it."""

    title: ClassVar[str] = "Where your simulation misses"

    def body(self, diagnosis: Diagnosis) -> Markup:
        if diagnosis.given is None:
            return Markup("")
        said = fill("prose.html.j2", sentences=[diagnosis.given.sentence], below="")
        drawn = (("given", "your simulation"), ("base", "base model"))
        level = diagnosis.rule.place.significant
        return said + _map(diagnosis.given.mismatch, level, _GIVEN_MISSES, drawn, classes="as-given")


def _map(
    bins: tuple[MismatchBin, ...],
    level: float,
    intro: str,
    models: tuple[tuple[str, str], ...],
    within: tuple[Within, ...] = (),
    classes: str = "",
) -> Markup:
    """The map of these `bins` by axis; from a p-value of `level` on they are grey."""
    axes: dict[str, list[MismatchBin]] = {}
    for cell in bins:
        axes.setdefault(cell.axis, []).append(cell)
    if not axes:
        return Markup("")
    after = any(math.isfinite(cell.excess_extended) for cell in bins)
    # One scale for all axes but frequency, where the excess is far larger in bins that the observer suppresses.
    wide = _highest(cell for name, cells in axes.items() if name != "frequency" for cell in cells)
    return fill(
        "mismatch.html.j2",
        intro=intro,
        classes=classes,
        grey=f"{level:g}" if any(cell.p_value >= level for cell in bins) else "",
        within=[_part(part) for part in within],
        legend=legend(after, marks=True, models=models),
        axes=[
            _axis(name, cells, after, _highest(cells) if name == "frequency" else wide, level)
            for name, cells in axes.items()
        ],
    )


def _part(part: Within) -> dict[str, str]:
    return {
        "many": "Only" if part.only else "Mostly",
        "phrase": part.phrase,
        "given": part.given,
        "share": percent(part.share),
        "samples": percent(part.samples),
        "excess": number(part.excess, 2),
        "elsewhere": number(part.excess_elsewhere, 2),
        "p": p_equals(part.p_value),
    }


def _highest(cells: Iterable[MismatchBin]) -> float:
    """Upper end of the scale of excesses."""
    return 1.5 * max([10.0, *(cell.excess for cell in cells if math.isfinite(cell.excess))])


def _axis(name: str, cells: list[MismatchBin], after: bool, high: float, level: float) -> dict[str, Any]:
    # The strongest bins keep their natural order: a map is read along its axis.
    kept = sorted(range(len(cells)), key=lambda k: -_finite(cells[k].share))[:_MOST]
    # Bold: a share twice that of an even distribution over the bins; on short axes, 60 %.
    striking = 2.0 * sum(_finite(cell.share) for cell in cells) / len(cells) if len(cells) > 3 else 0.6
    rest = sum(_finite(cell.share) for k, cell in enumerate(cells) if k not in kept)
    return {
        "heading": words(_AXES.get(name, name)).capitalize(),
        "rows": [
            _row(cells[k], _finite(cells[k].share) >= striking, after, high, level) for k in sorted(kept)
        ],
        "more": len(cells) - len(kept),
        "rest": percent(rest),
    }


def _row(cell: MismatchBin, striking: bool, after: bool, high: float, level: float) -> dict[str, Any]:
    extended = cell.excess_extended if after and math.isfinite(cell.excess_extended) else None
    return {
        "bin": cell.bin,
        "css": "chance" if cell.p_value >= level else "striking" if striking else "",
        "width": f"{100 * min(max(_finite(cell.share), 0.0), 1.0):.1f}",
        "share": percent(cell.share),
        "scale": gauge(cell.excess, extended, low=0.5, high=high, floor=1.0),
        "excess": pair(number(cell.excess, 2), None if extended is None else number(extended, 2)),
    }


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0
