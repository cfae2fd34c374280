"""Text files of columns: any suffix of text, any separator, plain, gzipped or zipped."""

import codecs
import io
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings.limits import require_short_lines
from frictionjax.recordings.readers.base import AbstractColumnTable
from frictionjax.recordings.readers.fast import numbers_of
from frictionjax.recordings.readers.layout import (
    NUMBER,
    Layout,
    content_lines,
    find_layout,
    split,
    with_decimal_points,
)
from frictionjax.recordings.readers.packed import contents
from frictionjax.recordings.readers.stamps import is_stamp, seconds_between
from frictionjax.recordings.words import shown

_HEAD = 1 << 20
"""Bytes from which the layout is read."""


class TextTable(AbstractColumnTable):
    """A text file of columns: its content, how that is encoded, whether its numbers have decimal commas, its layout."""

    path: Path = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    data: bytes = eqx.field(static=True)
    encoding: str = eqx.field(static=True)
    decimal_comma: bool = eqx.field(static=True)
    layout: Layout

    def has(self, name: str) -> bool:
        place = self.layout.index.get(name)
        return place is not None and (place >= 0 or self._is_repeated(name))

    def _is_repeated(self, name: str) -> bool:
        """Whether all columns of this name hold the same: a logger may write a time column for each channel."""
        first, *others = self._read(self._places(name))
        return all(np.array_equal(first, other) for other in others)

    def _places(self, name: str) -> list[int]:
        place = self.layout.index[name]
        return [place] if place >= 0 else [k for k, own in enumerate(self.names) if own == name]

    def absence(self, name: str) -> str:
        if name in self.layout.index:
            return f"there is more than one column `{shown(name)}`, and they differ"
        if self.names == tuple(str(k) for k in range(1, self.layout.width + 1)):
            return f"there is no column `{shown(name)}` (no header was found, so columns go by their number)"
        return f"there is no column `{shown(name)}`"

    def read(self, names: Sequence[str]) -> list[Float[np.ndarray, " _"]]:
        return self._read([self._places(name)[0] for name in names])

    def _read(self, columns: list[int]) -> list[Float[np.ndarray, " _"]]:
        layout = self.layout
        if self.encoding == "utf-8-sig" and layout.separator is not None:
            fast = numbers_of(
                self.data,
                columns,
                layout.width,
                layout.separator,
                layout.start,
                decimal_comma=self.decimal_comma,
            )
            if fast is not None:
                return fast
        text = self._text()
        values = self._read_plainly(text)
        if values is None:
            return self._read_slowly(columns, text)
        return [np.ascontiguousarray(values[:, k]) for k in columns]

    def _text(self) -> str:
        """The whole content, with `\\n` line ends and decimal points."""
        text = _decoded(self.data, self.encoding)
        return (with_decimal_points(text) or text) if self.decimal_comma else text

    def unit(self, name: str) -> str:
        return self.layout.units.get(name, "")

    def clock(self, name: str) -> None:
        return None

    def place(self, index: int) -> str:
        for count, (number, _) in enumerate(content_lines(self._text().split("\n"), self.layout.start)):
            if count == index:
                return f"line {number}"
        return f"sample {index + 1}"

    def _read_plainly(self, text: str) -> Float[np.ndarray, "_ _"] | None:
        """All columns by NumPy's parser; None when it cannot read the file."""
        comments = [sign for sign in "#%" if sign in text]
        try:
            values = np.loadtxt(
                io.StringIO(text),
                delimiter=self.layout.separator,
                comments=comments or None,
                quotechar='"',
                skiprows=self.layout.start,
                ndmin=2,
            )
        except ValueError:
            return None
        return values if values.shape[1] == self.layout.width else None

    def _read_slowly(self, columns: list[int], text: str) -> list[Float[np.ndarray, " _"]]:
        """Line by line: right for files with text in unused columns, and able to name the place of an error."""
        rows: list[list[float]] = []
        origins: dict[int, str] = {}
        # What is asked of a Module is wrapped at each asking, which would take longer than to read the line.
        width, separator, value = self.layout.width, self.layout.separator, self._value
        for number, line in content_lines(text.split("\n"), self.layout.start):
            fields = split(re.split("[#%]", line, maxsplit=1)[0], separator)
            if len(fields) == width + 1 and not fields[-1]:
                fields = fields[:-1]
            if len(fields) != width:
                raise InputError(
                    f"{len(fields)} value{'s' * (len(fields) != 1)} where the file has {width} columns",
                    file=shown(self.path, 200),
                    place=f"line {number}",
                    cure="Complete the line or delete it (a file cut short ends like this)",
                )
            rows.append([value(fields[k], number, k, origins) for k in columns])
        return list(np.array(rows, dtype=np.float64).reshape(-1, len(columns)).T.copy())

    def _value(self, field: str, line: int, column: int, origins: dict[int, str]) -> float:
        """The number in a `field`; NaN where it is empty; of a date and time the seconds since the first one, which
        `origins` keeps by column."""
        if NUMBER.fullmatch(field):
            return float(field)
        if is_stamp(field):
            try:
                return seconds_between(origins.setdefault(column, field), field)
            except ValueError:  # the thirteenth month
                raise self._not_a_number(field, line, self.names[column]) from None
        if not field:
            return np.nan
        raise self._not_a_number(field, line, self.names[column])

    def _not_a_number(self, field: str, line: int, name: str) -> InputError:
        cure = "Correct the value, or start the line with # to leave it out"
        if re.fullmatch(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", field):
            cure = f'Write decimal points, not commas: "{field.replace(",", ".")}"'
        problem = f'"{shown(field, 30)}" is not a number'
        return InputError(
            problem, file=shown(self.path, 200), place=f"line {line}, column `{shown(name)}`", cure=cure
        )


def open_text(path: Path) -> TextTable:
    """Open a text file of columns.

    Separators: comma, semicolon, tab, or blanks. Lines that start with # or % are comments; so is the rest of a
    line of numbers after such a sign. Numbers have decimal points; or, where another sign separates them, commas, and
    a warning says so. Dates with a time of day, and times of day alone, are seconds since the first one. UTF-8 (with or
    without a byte order mark), UTF-16 with one, else Latin-1.

    **Arguments:**

    - `path`: an existing file; gzip and zip (of one file) are recognised by the content, not by the suffix.

    **Returns:** its table.

    **Raises:** `InputError` for a file that is not text, a damaged packed file, and one without numbers.
    """
    return table_of(path, contents(path))


def table_of(path: Path, data: bytes) -> TextTable:
    """The table in the content of a text file, as from `open_text`.

    **Arguments:**

    - `path`: the file, for messages.
    - `data`: its content, unpacked.

    **Returns:** its table.

    **Raises:** `InputError` for content that is not text, and without numbers.
    """
    file = shown(path, 200)
    encoding = _encoding(data, file)
    head = data
    if len(data) > _HEAD and encoding != "utf-16":
        head = data[: data.rfind(b"\n", 0, _HEAD) + 1] or data
    require_short_lines(data, file)
    text = _decoded(head, encoding)
    pointed = with_decimal_points(text)
    if pointed is not None:
        warnings.warn(
            FrictionjaxWarning(f"{file}: commas in numbers were read as decimal points."), stacklevel=2
        )
    layout = find_layout(text if pointed is None else pointed, file)
    return TextTable(path, layout.names, data, encoding, pointed is not None, layout)


def _encoding(data: bytes, file: str) -> str:
    """UTF-16 where the first bytes say so, else UTF-8 if all of it is, else Latin-1."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        try:
            data.decode("utf-16")
        except UnicodeDecodeError:
            raise InputError(
                "the file is not UTF-16 text, as its first bytes say", file=file, cure="Save it as UTF-8"
            ) from None
        return "utf-16"
    if b"\0" in data:
        raise InputError(
            "the file is binary, not text",
            file=file,
            cure="Export it as text, or give it the suffix of its format",
        )
    if data.isascii():
        return "utf-8-sig"
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _decoded(data: bytes, encoding: str) -> str:
    """Text with `\\n` line ends."""
    return data.decode(encoding).replace("\r\n", "\n").replace("\r", "\n")
