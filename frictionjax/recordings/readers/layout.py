"""The layout of a text file of numbers: separator, header, and where the numbers begin."""

import csv
import re
from collections import Counter
from collections.abc import Iterator

import equinox as eqx

from frictionjax.core import InputError
from frictionjax.recordings.readers.stamps import is_stamp
from frictionjax.recordings.units import is_unit, parse_unit
from frictionjax.recordings.words import shown

# ASCII only, like NumPy's parser: Python's `float` would also take "1_000" and digits of other scripts.
NUMBER = re.compile(
    r"[+-]?(?:(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?|nan|inf|infinity)", re.ASCII | re.IGNORECASE
)
COMMENT = ("#", "%")
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_LINE_OF_NUMBERS = re.compile(r'^[ \t"+-]*[\d,].*$', re.ASCII | re.MULTILINE)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)|(?<![\w.]),(?=\d)", re.ASCII)
_NO_VALUE = {"", "na", "n/a", "null", "none"}
_ROLES = {"t", "u", "x", "v", "force", "reference", "temperature", "normal_force", "supply", "simulated"}
# Columns of a file without a header that has exactly so many of them.
_BARE = {2: ("u", "x"), 3: ("t", "u", "x")}
_HEAD = 400  # lines from which the layout is read


class Layout(eqx.Module):
    """How a text file of columns is written.

    **Attributes:**

    - `separator`: `","`, `";"`, a tab, or None for runs of white space.
    - `width`: number of columns.
    - `names`: the columns' names; `"1"`, `"2"`, ... when there is no header.
    - `index`: every name of a column, and its number from 1 on where no column has it for a name, with the position;
        -1 marks a name that occurs twice.
    - `start`: number of lines before the numbers.
    - `units`: a column's name -> its unit, from a line of units below the header.
    """

    separator: str | None = eqx.field(static=True)
    width: int = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    index: dict[str, int] = eqx.field(static=True)
    start: int = eqx.field(static=True)
    units: dict[str, str] = eqx.field(static=True)


def content_lines(lines: list[str], start: int = 0) -> Iterator[tuple[int, str]]:
    """The lines that are neither blank nor comment, stripped of blanks, with their numbers from 1."""
    for number, line in enumerate(lines[start:], start=start + 1):
        stripped = line.strip()
        if stripped and not stripped.startswith(COMMENT):
            yield number, line.strip(" \r")


def split(line: str, separator: str | None) -> list[str]:
    """The fields of one line, without the blanks and the quotes around them."""
    if '"' not in line:
        return [field.strip() for field in line.split(separator)]
    if separator is None:
        line, separator = line.replace("\t", " ").strip(), " "
    try:
        return [
            field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        ]
    except csv.Error:  # a field beyond the limit of the csv module
        return [field.strip() for field in line.split(separator)]


def with_decimal_points(text: str) -> str | None:
    """The `text` of a file of numbers with decimal commas, with points in their place; None when it has none.

    Where another sign separates the columns, and no number has a point, commas inside numbers are decimal.
    """
    body = _body([line for _, line in content_lines(text.split("\n", _HEAD)[:_HEAD])])
    for separator in (";", "\t", None):
        rows = [split(line, separator) for line in body]
        commas = [len(row) > 1 and any(_COMMA_NUMBER.fullmatch(field) for field in row) for row in rows]
        points = any("." in field and NUMBER.fullmatch(field) for row in rows for field in row)
        if sum(commas) >= 0.6 * max(len(body), 1) and not points:
            return _LINE_OF_NUMBERS.sub(lambda line: _DECIMAL_COMMA.sub(".", line[0]), text)
    return None


def find_layout(text: str, file: str) -> Layout:
    """Find the layout of a file from its first lines.

    A header is a line of as many names as the numbers have columns; lines of units, types and the like may stand
    between them, and anything above it: of a block of such lines the first is the header.
    Without a header the columns are called "1", "2", ..., and two columns are also u and x, three t, u and x.
    A comment line directly above the numbers serves as header when it has a name for every column.

    **Arguments:**

    - `text`: the whole file, with `\\n` line ends.
    - `file`: its name for messages.

    **Returns:** the `Layout`.

    **Raises:** `InputError` for a file without numbers or with a header that does not match them.
    """
    lines = text.split("\n", _HEAD)[:_HEAD]
    head = list(content_lines(lines))
    if not head:
        raise InputError(
            "the file is empty", file=file, cure="Give a file with a header line and columns of numbers"
        )
    separator, width = _separator([line for _, line in head])
    usual = max(_numbers_in(split(line, separator)) for line in _body([line for _, line in head]))
    above: list[tuple[int, str]] = []
    start = None
    for number, line in head:
        fields = split(line, separator)
        numbers = _numbers_in(fields)
        # A line of a preamble may hold a number or two.
        if numbers and (len(fields) >= width or not above) and (usual < 3 or 2 * numbers > usual):
            start = number - 1
            break
        if above and len(fields) == width and all(field.lower() in _NO_VALUE for field in fields):
            start = number - 1  # the reader will say what is wrong with it
            break
        above.append((number, line))
    if start is None:
        raise InputError(
            "no line of numbers found", file=file, place=f"line {head[-1][0]}", cure="Give columns of numbers"
        )
    block = _header_block(above, separator, width)
    header = block[0] if block else None
    if header is None and above:
        number, line = above[-1]
        raise InputError(
            f'"{shown(line)}" is no header: the numbers below it have {width} column{"s" * (width != 1)}',
            file=file,
            place=f"line {number}",
            cure="Give one name a column, with the separator of the numbers, or start the line with #",
        )
    bare = header is None
    header = header or _commented_header(lines[:start], separator, width)
    return Layout(separator, width, *_index(header, width, bare and header is None), start, _units(block))


def _body(lines: list[str]) -> list[str]:
    """The last of the `lines`: the header may differ."""
    body = lines[-20:] if len(lines) < 40 else lines[-40:]
    return body[1:] or body


def _numbers_in(fields: list[str]) -> int:
    """How many of the `fields` are numbers, or a date and time."""
    return sum(bool(NUMBER.fullmatch(field) or is_stamp(field)) for field in fields)


def _header_block(above: list[tuple[int, str]], separator: str | None, width: int) -> list[list[str]]:
    """The header, and the lines of units, types and the like below it: the lines directly `above` the numbers that have
    a field for every column; no blank line stands between these."""
    block: list[list[str]] = []
    below = None
    for number, line in reversed(above):
        names = _names(line, separator, width)
        if names is None or (below is not None and number != below - 1):
            break
        block.insert(0, names)
        below = number
    # A line of a preamble that a spreadsheet has filled up with empty fields is no header.
    filled = [sum(map(bool, names)) for names in block]
    return block[filled.index(max(filled)) :] if block else block


def _units(block: list[list[str]]) -> dict[str, str]:
    """Column -> unit, from the first line below the header that is one of units; a line may begin with that word."""
    for line in block[1:]:
        cells = [cell for cell in line if cell and cell.lower() not in ("unit", "units", "einheit")]
        units = [cell for cell in cells if is_unit(cell)]
        if any(parse_unit(cell.strip("[]()")) for cell in units) and 2 * len(units) >= len(cells):
            pairs = zip(block[0], line, strict=True)
            return {name: unit.strip("[]()") for name, unit in reversed(list(pairs)) if is_unit(unit)}
    return {}


def _separator(lines: list[str]) -> tuple[str | None, int]:
    """The separator and the number of columns, from the last of the lines (the header may differ)."""
    body = _body(lines)
    for separator in ("\t", ";", ","):
        widths = Counter(len(split(line, separator)) for line in body)
        width, votes = widths.most_common(1)[0]
        if width > 1 and votes >= 0.6 * len(body):
            # A separator at the end of every line closes the last column, unless the header names another one.
            closed = all(not split(line, separator)[-1] for line in body)
            named = [field for field in split(lines[0], separator) if field]
            return separator, width - (closed and len(named) < width)
    return None, Counter(len(split(line, None)) for line in body).most_common(1)[0][0]


def _names(line: str, separator: str | None, width: int) -> list[str] | None:
    """The names in a header line, which may use another separator than the numbers; None when their number differs."""
    others = ("\t", ";", ",", None)  # blanks come last: "t, u, x" above columns between blanks
    attempts = [split(line, other) for other in dict.fromkeys((separator, *others) if separator else others)]
    attempts.append([field.strip() for field in re.split(r"\s{2,}|\t", line)])
    for fields in attempts:
        if len(fields) == width + 1 and not fields[-1]:
            fields = fields[:-1]
        if len(fields) == width and any(fields):
            return fields
    return None


def _commented_header(above: list[str], separator: str | None, width: int) -> list[str] | None:
    """Names from a comment line directly above the numbers, as `numpy.savetxt` writes them."""
    above = [line.strip() for line in above if line.strip()]
    if not above:
        return None
    names = _names(above[-1].lstrip("#% "), separator, width)
    # Separated by blanks, any comment of three words would count as three names.
    return names if names and (separator or _ROLES & set(names)) else None


def _index(names: list[str] | None, width: int, bare: bool) -> tuple[tuple[str, ...], dict[str, int]]:
    """The column of each name."""
    numbers = tuple(str(k) for k in range(1, width + 1))
    index: dict[str, int] = {}
    for position, name in enumerate(names or numbers):
        index[name] = -1 if name in index else position
    for position, number in enumerate(numbers):
        index.setdefault(number, position)
    if bare:
        index |= {name: position for position, name in enumerate(_BARE.get(width, ()))}
    return tuple(names or numbers), index
