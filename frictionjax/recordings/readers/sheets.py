"""Spreadsheets: `.xlsx`, `.xls`, `.ods`."""

import datetime
import warnings
from pathlib import Path
from typing import Any

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings.readers.extra import clean_errors, library
from frictionjax.recordings.readers.text import TextTable, table_of
from frictionjax.recordings.words import listed, shown


def open_sheet(path: Path) -> TextTable:
    """Open a spreadsheet: the sheet with most numbers, read like a text file, so that lines above the header and below
    it do no harm; a line is a row of the sheet.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table.

    **Raises:** `InputError` where python-calamine is absent, for a damaged file, and one without numbers. Warns with
    `FrictionjaxWarning` where other sheets hold numbers, too.
    """
    calamine = library("python_calamine", path)
    cure = "Save it again, or export the sheet as CSV"
    with (
        clean_errors(path, "is not a spreadsheet that can be read", cure),
        calamine.CalamineWorkbook.from_path(path) as book,
    ):
        sheets = {
            name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names
        }
    counts = {name: sum(_is_number(cell) for row in rows for cell in row) for name, rows in sheets.items()}
    filled = [name for name, count in counts.items() if count]
    if not filled:
        raise InputError("no sheet holds numbers", file=shown(path, 200), cure="Give columns of numbers")
    most = max(filled, key=counts.__getitem__)
    if len(filled) > 1:
        others = listed(name for name in filled if name != most)
        warnings.warn(
            FrictionjaxWarning(
                f"{shown(path, 200)}: the sheet `{shown(most)}` was read, which holds most numbers; {others} was not."
            ),
            stacklevel=2,
        )
    rows = sheets[most]
    used = [k for k in range(max(map(len, rows))) if any(k < len(row) and row[k] != "" for row in rows)]
    lines = ["\t".join(_text(row[k]) if k < len(row) else "" for k in used) for row in rows]
    return table_of(path, "\n".join(lines).encode())


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _text(cell: Any) -> str:
    """A cell as a field of a text file; times of day and durations in s."""
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(sep=" ")
    if isinstance(cell, datetime.timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, datetime.time):
        since = datetime.timedelta(
            hours=cell.hour, minutes=cell.minute, seconds=cell.second, microseconds=cell.microsecond
        )
        return repr(since.total_seconds())
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, int | float):
        return repr(cell)
    return " ".join(str(cell).replace('"', "'").split())
