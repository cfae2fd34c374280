"""Which reader reads which suffix."""

from pathlib import Path

from frictionjax.core import InputError
from frictionjax.recordings.limits import require_small, too_large
from frictionjax.recordings.readers.base import AbstractTable, Reader
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


def open_table(path: Path) -> AbstractTable:
    """Open a file of measured columns with the reader of its suffix.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table.

    **Raises:** `InputError` when no reader knows the suffix or the file is not what its suffix says.
    """
    name = path.name.lower()
    for suffix, reader in READERS.items():
        if name.endswith(suffix):
            require_small(path)
            try:
                return reader(path)
            except MemoryError:
                raise too_large(shown(path, 200), "its content does not fit into memory, and") from None
    raise InputError(
        f'no reader for the suffix "{shown(path.suffix)}"' if path.suffix else "the file has no suffix",
        file=shown(path, 200),
        cure=f"Save it in one of the formats that are read: {', '.join(_SUFFIXES)}",
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
