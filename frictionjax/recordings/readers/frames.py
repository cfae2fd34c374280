"""Column files: Parquet and Feather (Arrow IPC), by polars."""

from pathlib import Path

from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import clean_errors, library
from frictionjax.recordings.words import shown


def open_parquet(path: Path) -> ArrayTable:
    """Open a Parquet file.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table; dates are s since the first, durations s.

    **Raises:** `InputError` where polars is absent, for a damaged file, and one without a column of numbers.
    """
    return _open(path, "read_parquet")


def open_feather(path: Path) -> ArrayTable:
    """Open a Feather file (version 2, Arrow IPC); else as `open_parquet`.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table.

    **Raises:** as `open_parquet`.
    """
    return _open(path, "read_ipc")


def _open(path: Path, reader: str) -> ArrayTable:
    polars = library("polars", path)
    found = Collected("column")
    with clean_errors(path, "cannot be read", "Write the file again"):
        for column in getattr(polars, reader)(path.read_bytes()):
            kind = column.dtype
            if kind.is_numeric() or kind.is_temporal() or kind == polars.Boolean:
                if kind.is_numeric() and column.null_count():
                    column = column.cast(polars.Float64).fill_null(float("nan"))
                found.add(column.name, column.to_numpy())
            else:
                found.refused[column.name] = f"holds {shown(kind)}, not numbers"
    return found.table(path)
