"""Charts of the report: panels of series with axes, as inline SVG that the page's script can zoom and read.

A chart is complete without the script. Its points lie on a grid of whole numbers, in paths that are short as text.
"""

import math
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from markupsafe import Markup

from frictionjax.report.format import number
from frictionjax.report.series import envelope, limits
from frictionjax.report.template import fill

COLUMNS, ROWS = 4000, 2000
"""The grid of a panel: steps along its axes."""

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM, _GAP = 460, 54, 8, 10, 36, 14
_DRAWN = 450  # columns of an envelope: a chart is about so many pixels wide


class Series(eqx.Module):
    """One line, row of dots, or band of a panel.

    **Attributes:**

    - `label`: what it is, in words.
    - `colour`: `"measured"`, `"base"`, `"extended"`, `"given"` or `"band"`.
    - `x`, `y`: in the units of the axes, shape `(n,)`; NaN makes a gap.
    - `low`: lower edge of a band whose upper edge is `y`, shape `(n,)`; None for a line.
    - `style`: `"line"`, `"thick"`, `"dashed"` or `"dots"`.
    """

    label: str = eqx.field(static=True)
    colour: str = eqx.field(static=True)
    x: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"] | None = None
    style: Literal["line", "thick", "dashed", "dots"] = eqx.field(static=True, default="line")


class Panel(eqx.Module):
    """Series over one pair of axes.

    **Attributes:** `name` of what is drawn upwards, its `unit` as text, the `series`, the `limits` of the axis, the
    `height` (in hundredths of about an inch), and a `note` in its corner.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    series: tuple[Series, ...]
    limits: tuple[float, float] = eqx.field(static=True)
    height: int = eqx.field(static=True, default=130)
    note: str = eqx.field(static=True, default="")

    @property
    def label(self) -> str:
        """Name and unit, as beside an axis."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


class Chart(eqx.Module):
    """Panels, one below the other, over one horizontal axis.

    **Attributes:** `name` and `unit` of that axis, the `panels`, the `limits` of the axis; `tinted`: an interval of it
    that another chart shows closely; `logarithmic`: whether the axis shows decades; `path`: whether the lines are paths
    in the plane, which turn back along the axis.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    panels: tuple[Panel, ...]
    limits: tuple[float, float] = eqx.field(static=True)
    tinted: tuple[float, float] | None = eqx.field(static=True, default=None)
    logarithmic: bool = eqx.field(static=True, default=False)
    path: bool = eqx.field(static=True, default=False)

    @property
    def label(self) -> str:
        """Name and unit, as below the axis."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


def svg(chart: Chart, words: str) -> Markup:
    """The chart as an inline SVG that is as wide as its container.

    **Arguments:**

    - `chart`: what is drawn.
    - `words`: what a screen reader says of it.
    """
    low, high = _axis(chart.limits, chart.logarithmic)
    inner = _WIDTH - _LEFT - _RIGHT
    top, panels = _TOP, []
    for panel in chart.panels:
        panels.append(_panel(panel, chart, (low, high), top, inner))
        top += panel.height + _GAP
    height = top - _GAP + _BOTTOM
    return fill(
        "chart.html.j2",
        words=words,
        width=_WIDTH,
        height=height,
        left=_LEFT,
        inner=inner,
        columns=COLUMNS,
        rows=ROWS,
        panels=panels,
        label=chart.label,
        unit=chart.unit,
        name=chart.name,
        low=low,
        high=high,
        logarithmic=chart.logarithmic,
        path=chart.path,
        ticks=[(_LEFT + inner * (at - low) / (high - low), word) for at, word in _ticks_along(chart)],
        floor=top - _GAP,
        tinted=_tinted(chart, low, high),
    )


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round numbers on an axis from `low` to `high`, at `most` so many, with their text."""
    span = high - low
    raw = span / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(size * power for size in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if size * power >= raw * (1 - 1e-9))
    decimals = max(0, -math.floor(math.log10(step) + 1e-9) + (round(step / power * 10) == 25))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(k * step, _fixed(k * step, decimals)) for k in range(first, last + 1)]


def _fixed(value: float, decimals: int) -> str:
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        return number(value)
    return f"{value:.{decimals}f}".replace("-", "−") if value else "0"


def _ticks_along(chart: Chart) -> list[tuple[float, str]]:
    low, high = _axis(chart.limits, chart.logarithmic)
    if not chart.logarithmic:
        return ticks(low, high, 6)
    sizes = (1.0, 2.0, 5.0) if high - low < 2.5 else (1.0,)
    powers = range(math.floor(low) - 1, math.ceil(high) + 1)
    found = [(math.log10(size) + power, number(size * 10.0**power, 1)) for power in powers for size in sizes]
    return [(at, word) for at, word in found if low - 1e-9 <= at <= high + 1e-9]


def _axis(ends: tuple[float, float], logarithmic: bool) -> tuple[float, float]:
    low, high = (math.log10(end) for end in ends) if logarithmic else ends
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _tinted(chart: Chart, low: float, high: float) -> tuple[float, float] | None:
    if chart.tinted is None:
        return None
    start, stop = (COLUMNS * (end - low) / (high - low) for end in chart.tinted)
    return round(start, 1), round(max(stop - start, 4.0), 1)


def _panel(panel: Panel, chart: Chart, along: tuple[float, float], top: int, inner: int) -> dict[str, object]:
    low, high = panel.limits if panel.limits[1] > panel.limits[0] else limits(np.zeros(1))
    marks = ticks(low, high, 5 if panel.height > 100 else 3)
    return {
        "top": top,
        "height": panel.height,
        "label": panel.label,
        "unit": panel.unit,
        "note": panel.note,
        "low": low,
        "high": high,
        "ticks": [(top + panel.height * (high - at) / (high - low), word) for at, word in marks],
        "series": [
            {
                "label": one.label,
                "css": f"{one.colour} {'area' if one.low is not None else one.style}",
                "d": _path(one, chart, along, (low, high)),
            }
            for one in panel.series
        ],
    }


def _path(one: Series, chart: Chart, along: tuple[float, float], up: tuple[float, float]) -> str:
    x, y, low = one.x, one.y, one.low
    if low is not None:
        x, y, low = _thinned(x, y, low)
    elif not chart.path and one.style != "dots":
        x, y = envelope(x, y, _DRAWN)
    if chart.logarithmic:
        x = np.log10(x)
    columns = _grid(x, along, COLUMNS)
    rows = ROWS - _grid(y, up, ROWS)
    if low is None:
        kept = np.isfinite(x) & np.isfinite(y)
        return _moves(columns, rows, kept, dots=one.style == "dots")
    kept = np.isfinite(x) & np.isfinite(y) & np.isfinite(low)
    if not kept.any():
        return ""
    floor = ROWS - _grid(low, up, ROWS)
    around = np.concatenate([columns[kept], columns[kept][::-1]])
    edges = np.concatenate([rows[kept], floor[kept][::-1]])
    return _moves(around, edges, np.ones(around.size, bool), dots=False) + "z"


def _thinned(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], low: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """A band in as many steps as a chart has columns, each as wide as its widest sample."""
    starts = np.arange(0, x.size, max(1, x.size // _DRAWN))
    return x[starts], np.fmax.reduceat(y, starts), np.fmin.reduceat(low, starts)


def _grid(values: Float[np.ndarray, " n"], ends: tuple[float, float], steps: int) -> Int[np.ndarray, " n"]:
    """Where the `values` lie between the `ends`, in `steps`; far beyond the ends, a little beyond them."""
    with np.errstate(invalid="ignore", over="ignore"):
        at = np.clip(steps * (values - ends[0]) / (ends[1] - ends[0]), -steps, 2 * steps)
    return np.rint(np.nan_to_num(at, nan=0.0, posinf=2.0 * steps, neginf=-steps)).astype(np.int64)


def _moves(
    columns: Int[np.ndarray, " n"], rows: Int[np.ndarray, " n"], kept: np.ndarray, *, dots: bool
) -> str:
    """Path data: absolute where a line begins, relative along it. A dot is a line of no length."""
    if dots:
        return "".join(
            f"M{x} {y}h0" for x, y in zip(columns[kept].tolist(), rows[kept].tolist(), strict=True)
        )
    edges = np.flatnonzero(np.diff(np.concatenate([[0], kept.astype(np.int8), [0]])))
    parts = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        x, y = columns[begin:end], rows[begin:end]
        steps = zip(np.diff(x).tolist(), np.diff(y).tolist(), strict=True)
        tail = " ".join(f"{dx} {dy}" for dx, dy in steps if dx or dy)
        parts.append(f"M{x[0]} {y[0]}l{tail or '0 0'}")
    return "".join(parts)
