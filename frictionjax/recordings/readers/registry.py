"""Which reader reads which suffix."""

from pathlib import Path

from frictionjax.core import InputError
from frictionjax.recordings.limits import require_small, too_large
from frictionjax.recordings.readers.base import AbstractColumnTable, Reader
from frictionjax.recordings.readers.content_kind import kind_of
from frictionjax.recordings.readers.frames import open_feather, open_parquet
from frictionjax.recordings.readers.hdf5 import open_hdf5
from frictionjax.recordings.readers.json_file import open_json
from frictionjax.recordings.readers.mat import open_mat
from frictionjax.recordings.readers.mf4 import open_mf4
from frictionjax.recordings.readers.npz import open_npz
from frictionjax.recordings.readers.ros import open_bag
from frictionjax.recordings.readers.sheets import open_sheet
from frictionjax.recordings.readers.tdms import open_tdms
from frictionjax.recordings.readers.text import open_text
from frictionjax.recordings.words import shown

_TEXT = (".csv", ".tsv", ".txt", ".dat", ".log", ".asc")

READERS: dict[str, Reader] = {
    **{suffix + packed: open_text for suffix in _TEXT for packed in ("", ".gz", ".zip")},
    ".zip": open_text,
    ".xlsx": open_sheet,
    ".xls": open_sheet,
    ".ods": open_sheet,
    ".parquet": open_parquet,
    ".feather": open_feather,
    ".arrow": open_feather,
    ".mat": open_mat,
    ".h5": open_hdf5,
    ".hdf5": open_hdf5,
    ".npz": open_npz,
    ".json": open_json,
    ".json.gz": open_json,
    ".jsonl": open_json,
    ".tdms": open_tdms,
    ".mf4": open_mf4,
    ".mdf": open_mf4,
    ".bag": open_bag,
    ".db3": open_bag,
    ".mcap": open_bag,
}
"""The reader of each suffix; a new format is a module and a line here."""


_SUFFIXES = tuple(suffix for suffix in READERS if not suffix.endswith((".gz", ".zip")))


def open_table(path: Path) -> AbstractColumnTable:
    """Open a file of measured columns with the reader of its suffix; where that is none of ours, with that of its
    content, which is a table of text if nothing else.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table.

    **Raises:** `InputError` when no reader knows the content or the file is not what its suffix says.
    """
    name = path.name.lower()
    reader = next((reader for suffix, reader in READERS.items() if name.endswith(suffix)), None)
    require_small(path)
    try:
        return _open_by_content(path) if reader is None else reader(path)
    except MemoryError:
        raise too_large(shown(path, 200), "its content does not fit into memory, and") from None
    except InputError as error:
        raise _of_another_format(path, reader) or error from None


def _open_by_content(path: Path) -> AbstractColumnTable:
    """The table of a file whose suffix says nothing: of the format that its first bytes show, else as text."""
    kind = kind_of(path)
    if kind is not None and kind.suffix:
        return READERS[kind.suffix](path)
    try:
        return open_text(path)
    except InputError as error:
        if path.suffix.lower() == ".gz":
            raise
        suffix = f'the suffix "{shown(path.suffix)}"' if path.suffix else "a name without a suffix"
        raise InputError(
            f"{error.problem} (it was read as text, since {suffix} says no other format)",
            file=error.file,
            place=error.place,
            cure=f"{error.cure}, or save it in one of the formats that are read: {', '.join(_SUFFIXES)}",
        ) from None


def _of_another_format(path: Path, reader: Reader | None) -> InputError | None:
    """The error for a file that its `reader` refused and that holds another format; None where its content is that of
    the `reader`, or not known."""
    kind = kind_of(path)
    # An HDF5 file may well be MATLAB's.
    if kind is None or (kind.suffix and (reader is None or reader in (READERS[kind.suffix], open_mat))):
        return None
    return InputError(
        f"is {kind.what}{', which its suffix does not say' if kind.suffix else ''}",
        file=shown(path, 200),
        cure=kind.cure or f"Rename it, so that it ends in {kind.suffix}",
    )


def stem(path: Path) -> str:
    """The file's name without its suffix.

    **Arguments:**

    - `path`: a file, existing or not.

    **Returns:** its stem: "run" for "run.csv.gz".
    """
    name = path.name
    known = max((s for s in READERS if name.lower().endswith(s)), key=len, default=path.suffix)
    return name[: len(name) - len(known)] or name
