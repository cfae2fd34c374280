"""Small pieces of HTML: escaped text, tables, pictures, gauges. No physics here."""

import math
from collections.abc import Iterable, Sequence
from html import escape


def text(value: object) -> str:
    """Any value as escaped text."""
    return escape(str(value), quote=True)


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, classes: Sequence[str] = ()) -> str:
    """A table that scrolls sideways on a narrow screen; the first cell of a row is its heading.

    **Arguments:**

    - `head`: column headings, HTML.
    - `rows`: cells, HTML.
    - `classes`: CSS class of each row; none when empty.

    **Returns:**

    HTML.
    """
    rows = list(rows)
    classes = list(classes) or [""] * len(rows)
    top = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    body = "".join(
        f'<tr class="{css}"><th scope="row">{row[0]}</th>'
        + "".join(f"<td>{cell}</td>" for cell in row[1:])
        + "</tr>"
        for css, row in zip(classes, rows, strict=True)
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def picture(uri: str, caption: str) -> str:
    """A figure with its caption, which is also what a screen reader says.

    **Arguments:**

    - `uri`: `data:` URI of the image.
    - `caption`: plain text.
    """
    return f'<figure><img src="{uri}" alt="{text(caption)}"><figcaption>{text(caption)}</figcaption></figure>'


def pair(before: str, after: str | None) -> str:
    """A number of the base model and of the extended model: "before → after", each in its colour."""
    base = f'<span class="base">{before}</span>'
    return (
        base if after is None else f'{base} <span class="to">→</span> <span class="extended">{after}</span>'
    )


def gauge(base: float, extended: float | None, *, low: float, high: float, floor: float) -> str:
    """A logarithmic scale with a tick at the noise floor, a dot for the base and a square for the extended model.

    **Arguments:**

    - `base`, `extended`, `floor`: positive numbers in one unit; those that are not finite are left out.
    - `low`, `high`: ends of the scale, same unit.

    **Returns:**

    An inline SVG as wide as its container.
    """
    span = math.log(high / low)

    def at(value: float) -> float:
        return 100 * min(max(math.log(max(value, low) / low) / span, 0.0), 1.0)

    marks = ['<line class="rail" x1="0%" x2="100%" y1="9" y2="9"/>']
    if _drawable(floor):
        marks.append(f'<line class="floor" x1="{at(floor):.2f}%" x2="{at(floor):.2f}%" y1="2" y2="16"/>')
    if _drawable(base) and extended is not None and _drawable(extended):
        marks.append(f'<line class="way" x1="{at(extended):.2f}%" x2="{at(base):.2f}%" y1="9" y2="9"/>')
    if _drawable(base):
        marks.append(f'<circle class="base" cx="{at(base):.2f}%" cy="9" r="5"/>')
    if extended is not None and _drawable(extended):
        # A nested svg, because only its x takes a percentage.
        square = '<rect class="extended" x="-4.5" y="-4.5" width="9" height="9"/>'
        marks.append(f'<svg class="mark" x="{at(extended):.2f}%" y="9">{square}</svg>')
    return f'<svg class="gauge" height="18" aria-hidden="true">{"".join(marks)}</svg>'


def legend(extended: bool, *extra: tuple[str, str], marks: bool = False) -> str:
    """What the colours of a figure mean.

    **Arguments:**

    - `extended`: whether the extended model is drawn.
    - `extra`: further `(css class, words)`, drawn as swatches in front.
    - `marks`: whether the models are drawn as the dot and the square of a gauge, not as lines.
    """
    shape = " mark" if marks else ""
    items = [*extra, (f"base{shape}", "base model")]
    if extended:
        items.append((f"extended{shape}", "extended model"))
    swatches = "".join(
        f'<span class="key"><i class="swatch {css}"></i>{text(words)}</span>' for css, words in items
    )
    return f'<p class="legend">{swatches}</p>'


def _drawable(value: float) -> bool:
    return math.isfinite(value) and value > 0
