"""How results show themselves: a line of numbers, or a heading with sentences and tables, as text and as HTML.

The text of a noun is for people: it rounds. What keeps programs by their text (`core/programs.py`) never sees it,
because numbers are no part of a structure.
"""

import abc
import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from frictionjax.core.estimate import Estimate

WIDTH = 100  # characters of a line of a screen
_ROWS = 24  # of a table: what fits a screen
_CELL = 48  # characters of a cell
_ITEMS = 6  # of a list or a table inside a line
_FEW = 4  # numbers of an array that are listed


class TextGrid(NamedTuple):
    """A table: `head`, the headings of its columns, and `rows` of texts."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Display(NamedTuple):
    """What a noun shows of itself: a `title`, `sentences`, and `grids`."""

    title: str
    sentences: tuple[str, ...] = ()
    grids: tuple[TextGrid, ...] = ()


class AbstractDisplayed(eqx.Module):
    """A result that a terminal shows as text and a notebook as HTML, both from one `Display`."""

    @abc.abstractmethod
    def _display(self) -> Display:
        """Title, sentences and tables of this result, short enough for a screen."""

    def __repr__(self) -> str:
        return as_text(self._display())

    def _repr_html_(self) -> str:
        return as_html(self._display())


def as_text(display: Display) -> str:
    """What the `display` says, as lines of at most about `WIDTH` characters."""
    lines = [display.title]
    lines += [f"  {line}" for sentence in display.sentences for line in _wrapped(sentence)]
    for grid in display.grids:
        rows = [grid.head, *(_cut(row) for row in grid.rows[:_ROWS])]
        widths = [max(len(row[k]) for row in rows) for k in range(len(grid.head))]
        lines.append("")
        lines += ["  " + "  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        lines += _more(grid)
    return "\n".join(lines)


def as_html(display: Display) -> str:
    """What the `display` says, as HTML without style or script of its own."""
    parts = [f"<p><b>{escape(display.title)}</b></p>"]
    parts += [f"<p>{escape(sentence)}</p>" for sentence in display.sentences]
    for grid in display.grids:
        head = "".join(f"<th>{escape(cell)}</th>" for cell in grid.head)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
            for row in grid.rows[:_ROWS]
        )
        parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
        parts += [f"<p>{escape(line.strip())}</p>" for line in _more(grid)]
    return "<div>" + "".join(parts) + "</div>"


def one_line(module: eqx.Module, *leave_out: str) -> str:
    """A `module` as `Name(field=value, ...)` with its numbers, also inside transformations of JAX, where a number is a
    type; without the fields to `leave_out` and those that are None or an empty text."""
    fields = [field.name for field in dataclasses.fields(module) if field.name not in leave_out]  # type: ignore[arg-type]
    values = {name: getattr(module, name) for name in fields}
    inside = ", ".join(
        f"{name}={value_text(value)}" for name, value in values.items() if not _is_nothing(value)
    )
    return f"{type(module).__name__}({inside})"


def _is_nothing(value: Any) -> bool:
    return value is None or (isinstance(value, str) and not value)


def value_text(value: Any) -> str:
    """A `value` of a field in a few words: numbers to six digits, of longer arrays the type and the range."""
    if isinstance(value, Tracer):
        return value.aval.str_short(short_dtypes=True)
    if isinstance(value, jax.Array | np.ndarray | np.generic):
        return _array_text(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        items = [f"{key!r}: {value_text(item)}" for key, item in value.items()]
        return "{" + _listed(items) + "}"
    if isinstance(value, list | tuple):
        items = _listed([value_text(item) for item in value])
        return f"({items},)" if len(value) == 1 else f"({items})"
    return repr(value)


def estimate_row(name: str, estimate: Estimate) -> tuple[str, str, str, str]:
    """The row of a table for the parameter `name`: value, standard error and unit of its `estimate`."""
    known = f"{estimate.stderr:.2g}" if math.isfinite(estimate.stderr) else "not determined"
    return name, f"{estimate.value:.6g}", known, "" if estimate.unit == "1" else estimate.unit


ESTIMATES = ("parameter", "value", "standard error", "unit")
"""Headings of a table of `estimate_row`s."""


def estimates_grid(estimates: Mapping[str, Estimate]) -> TextGrid:
    """The table of `estimates` by name."""
    return TextGrid(ESTIMATES, tuple(estimate_row(name, estimate) for name, estimate in estimates.items()))


def records_grid(records: Sequence[Mapping[str, Any]]) -> TextGrid:
    """The table of `records`, mappings of names to values; the columns are those of all of them."""
    names = tuple(dict.fromkeys(name for record in records for name in record))
    rows = tuple(tuple(_cell(record.get(name)) for name in names) for record in records)
    return TextGrid(names, rows)


def signal_row(name: str, values: Any, unit: str) -> tuple[str, str, str, str]:
    """The row of a table of signals: `name`, least and largest of its `values`, and `unit`."""
    if isinstance(values, Tracer):
        return name, value_text(values), "", unit
    numbers = np.asarray(values)
    finite = numbers[np.isfinite(numbers)]
    if not finite.size:
        return name, "no number", "", unit
    return name, f"{finite.min():.4g}", f"{finite.max():.4g}", unit


SIGNALS = ("signal", "least", "largest", "unit")
"""Headings of a table of `signal_row`s."""


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _array_text(array: Any) -> str:
    numbers = np.asarray(array)
    if numbers.ndim == 0:
        return f"{numbers.item():.6g}" if numbers.dtype.kind in "fc" else str(numbers.item())
    if numbers.ndim == 1 and numbers.size <= _FEW:
        return "[" + ", ".join(_array_text(number) for number in numbers) + "]"
    kind = f"{numbers.dtype.kind}{8 * numbers.dtype.itemsize}[{','.join(map(str, numbers.shape))}]"
    if numbers.dtype.kind != "f" or not np.isfinite(numbers).any():
        return kind
    return f"{kind} from {np.nanmin(numbers):.4g} to {np.nanmax(numbers):.4g}"


def _listed(items: Iterable[str]) -> str:
    items = list(items)
    more = [f"... {len(items)} in all"] if len(items) > _ITEMS else []
    return ", ".join([*items[:_ITEMS], *more])


def _wrapped(sentence: str) -> list[str]:
    lines = [""]
    for word in sentence.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > WIDTH - 2:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


def _cut(row: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(cell if len(cell) <= _CELL else cell[: _CELL - 3] + "..." for cell in row)


def _more(grid: TextGrid) -> list[str]:
    left = len(grid.rows) - _ROWS
    return [f"  {left} more rows"] if left > 0 else []
