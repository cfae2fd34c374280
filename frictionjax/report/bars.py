"""Bars of the report: a few numbers of one unit side by side on a logarithmic axis, as inline SVG without a script."""

import math

import equinox as eqx
from markupsafe import Markup

from frictionjax.core.quantities import DisplayUnit
from frictionjax.report.format import engineering, number, quantity
from frictionjax.report.template import fill

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 460, 12, 8, 22, 36
_TITLE, _BAR, _GAP, _SPACE = (
    18,
    13,
    3,
    8,
)  # heights: the words above a group, a bar, between bars, between groups
_BESIDE, _LETTER = 5, 7.2  # widths: between a bar and its number, of a letter of it
_MOST_TICKS = 7


class BarGroup(eqx.Module):
    """Bars that belong together: the words above them, and `(css class, words, value)` of each; a value that is not
    finite, or is not positive, has a dash and no bar."""

    title: str = eqx.field(static=True)
    bars: tuple[tuple[str, str, float], ...] = eqx.field(static=True)


class Bars(eqx.Module):
    """Groups of bars over one axis.

    **Attributes:** `name` of the axis, `unit` of the values, the `groups`, and `floor`, the value of the line
    at the noise floor; not positive where there is none.
    """

    name: str = eqx.field(static=True)
    unit: str | DisplayUnit = eqx.field(static=True)
    groups: tuple[BarGroup, ...]
    floor: float = eqx.field(static=True)


def bars_svg(drawn: Bars, words: str) -> Markup:
    """The bars as an inline SVG that is as wide as its container.

    **Arguments:**

    - `drawn`: what is drawn.
    - `words`: what a screen reader says of it.
    """
    values = [value for group in drawn.groups for _, _, value in group.bars]
    sizes = [value for value in (*values, drawn.floor) if _is_drawn(value)] or [1.0]
    # The smallest number still has a bar, and the text beside each bar ends within the picture.
    low = math.log10(0.5 * min(sizes))
    span = max(
        (math.log10(value) - low) / (_WIDTH - _LEFT - _BESIDE - _LETTER * len(_text(value, drawn)))
        for value in sizes
    ) * (_WIDTH - _LEFT - _RIGHT)
    factor, label = engineering(drawn.unit, max(sizes))

    def at(value: float) -> float:
        return round(_LEFT + (_WIDTH - _LEFT - _RIGHT) * (math.log10(value) - low) / span, 1)

    groups, top = [], _TOP
    for group in drawn.groups:
        bars = [
            {
                "css": css,
                "words": f"{name}: {_text(value, drawn)}",
                "text": _text(value, drawn),
                "y": top + _TITLE + k * (_BAR + _GAP),
                "width": round(at(value) - _LEFT, 1) if _is_drawn(value) else 0.0,
            }
            for k, (css, name, value) in enumerate(group.bars)
        ]
        groups.append({"title": group.title, "y": top + _TITLE - 5, "bars": bars})
        top += _TITLE + len(bars) * (_BAR + _GAP) + _SPACE
    return fill(
        "bars.html.j2",
        words=words,
        width=_WIDTH,
        height=top + _BOTTOM,
        left=_LEFT,
        right=_WIDTH - _RIGHT,
        beside=_BESIDE,
        bar=_BAR,
        top=_TOP,
        foot=top,
        groups=groups,
        floor=at(drawn.floor) if _is_drawn(drawn.floor) else None,
        ticks=[(at(10.0**power / factor), number(10.0**power, 1)) for power in _powers(low, span, factor)],
        label=f"{drawn.name} ({label})" if label else drawn.name,
    )


def _is_drawn(value: float) -> bool:
    return math.isfinite(value) and value > 0.0


def _text(value: float, drawn: Bars) -> str:
    """A `value` with its unit, and over the noise floor."""
    over = _is_drawn(value) and _is_drawn(drawn.floor)
    return quantity(value, drawn.unit) + (f" ({number(value / drawn.floor, 2)} × floor)" if over else "")


def _powers(low: float, span: float, factor: float) -> range:
    """Powers of ten on an axis that begins at `low` and is `span` decades long, of values times the `factor`."""
    first = math.ceil(low + math.log10(factor))
    last = math.floor(low + span + math.log10(factor))
    return range(first, last + 1, 1 + (last - first) // _MOST_TICKS)
