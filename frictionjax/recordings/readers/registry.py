"""Which reader reads which suffix."""

from pathlib import Path

from frictionjax.core import InputError
from frictionjax.recordings.limits import require_small, too_large
from frictionjax.recordings.readers.base import AbstractTable, Reader
from frictionjax.recordings.readers.mat import open_mat
from frictionjax.recordings.readers.text import open_text
from frictionjax.recordings.words import shown

READERS: dict[str, Reader] = {
    ".csv": open_text,
    ".csv.gz": open_text,
    ".txt": open_text,
    ".txt.gz": open_text,
    ".mat": open_mat,
}
"""The reader of each suffix; a new format is a module and a line here."""


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
        cure=f"Save it in one of the formats that are read: {', '.join(READERS)}",
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
