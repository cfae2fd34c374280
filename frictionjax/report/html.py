"""Small pieces of the page: tables, pairs of numbers, legends, gauges, and charts with their captions."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from markupsafe import Markup

from frictionjax.report.bars import Bars, bars_svg
from frictionjax.report.chart import Chart, svg
from frictionjax.report.template import macro

Cell = str | Markup
"""Text, which is escaped, or HTML."""


def table(head: Sequence[str], rows: Iterable[Sequence[Cell]], *, classes: Sequence[str] = ()) -> Markup:
    """A table; the first cell of a row is its heading. On a narrow screen each row is a small list.

    **Arguments:**

    - `head`: column headings.
    - `rows`: cells.
    - `classes`: CSS class of each row; none when empty.
    """
    return macro("table", list(head), list(rows), list(classes))


def pair(before: str, after: str | None) -> Markup:
    """A number of the base model and of the extended model: "before → after", each in its colour."""
    return macro("pair", before, after)


MODELS = (("base", "base model"), ("extended", "extended model"))
"""CSS class and words of the models of a page."""


def legend(
    extended: bool,
    *extra: tuple[str, str],
    marks: bool = False,
    models: Sequence[tuple[str, str]] = MODELS,
) -> Markup:
    """What the colours of a chart mean.

    **Arguments:**

    - `extended`: whether the second model, the extended one, is drawn.
    - `extra`: further `(css class, words)`, drawn as swatches in front.
    - `marks`: whether the models are drawn as the dot and the square of a gauge, not as lines.
    - `models`: `(css class, words)` of the one or two that are drawn.
    """
    return macro("legend", list(models[: 2 if extended else 1]), list(extra), marks)


class Drawn(NamedTuple):
    """A chart as `svg`, or None where it could not be drawn, and its `caption`, which says so then."""

    svg: Markup | None
    caption: str


def figure(draw: Callable[[], Chart | Bars], caption: str) -> Markup:
    """A chart with its caption, which is also what a screen reader says; or in its place why there is none: the rest of
    the page does not depend on it.

    **Arguments:**

    - `draw`: makes the chart.
    - `caption`: plain text.
    """
    try:
        drawn = draw()
        picture = bars_svg(drawn, caption) if isinstance(drawn, Bars) else svg(drawn, caption)
        return macro("figure", Drawn(picture, caption))
    except Exception as error:
        said = f"{caption}: this picture could not be drawn ({type(error).__name__}: {error})."
        return macro("figure", Drawn(None, said))


def gauge(base: float, extended: float | None, *, low: float, high: float, floor: float) -> Markup:
    """A logarithmic scale with a tick at the noise floor, a dot for the base and a square for the extended model.

    **Arguments:**

    - `base`, `extended`, `floor`: positive numbers in one unit; those that are not finite are left out.
    - `low`, `high`: ends of the scale, same unit.

    **Returns:**

    An inline SVG as wide as its container.
    """
    span = math.log(high / low)

    def at(value: float | None) -> str | None:
        if value is None or not math.isfinite(value) or value <= 0:
            return None
        return f"{100 * min(max(math.log(max(value, low) / low) / span, 0.0), 1.0):.2f}"

    return macro("gauge", {"base": at(base), "extended": at(extended), "floor": at(floor)})
