"""fit/<recording>.csv: its columns, its name, and how one of an earlier run is recognised."""

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from frictionjax.diagnosis.recording_fit import RecordingFit

COLUMNS = (
    "t",
    "u",
    "x",
    "free_base",
    "free_extended",
    "predicted_base",
    "predicted_extended",
    "residual_force",
    "residual_force_std",
)
OPTIONAL = ("force", "free_given")
_HEADER = ",".join(COLUMNS)
_LONGEST = 255 - len(".csv")  # bytes of a file's name that every usual file system takes
_DIGITS = 8  # of the digest that stands for what is cut off or replaced


def fit_files(names: Iterable[str]) -> dict[str, str]:
    """The name of the CSV file of each recording, different ones on every file system.

    It is `<recording>.csv`, unless the recording's name is too long for a file, holds characters that none may have, or
    differs from an earlier one by such characters or by its letter case alone: then a digest makes the difference.

    **Arguments:**

    - `names`: of the recordings, all different.
    """
    files: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        stem = re.sub(r"[/\\\0]", "_", name.encode("utf-8", "backslashreplace").decode())
        if len(stem.encode()) > _LONGEST or _folded(stem) in taken:
            digest = hashlib.sha256(name.encode("utf-8", "backslashreplace")).hexdigest()[:_DIGITS]
            cut = stem.encode()[: _LONGEST - _DIGITS - 1].decode("utf-8", "ignore")
            stem = f"{cut}_{digest}"
        taken.add(_folded(stem))
        files[name] = f"{stem}.csv"
    return files


def _folded(stem: str) -> str:
    """The name for file systems that know neither letter case nor two ways to write an accent."""
    return unicodedata.normalize("NFC", stem).casefold()


def is_fit_csv(path: Path) -> bool:
    """Whether the file `path` is the fit/<recording>.csv of an earlier run."""
    if path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as stream:
        return stream.read(len(_HEADER)) == _HEADER.encode("ascii")


def write_fit_csv(recording: RecordingFit, file: Path) -> None:
    """Write one recording's fit/<recording>.csv: columns `COLUMNS`, one row a sample, nine significant digits; after
    them those of `OPTIONAL` that it has: the measured `force` where that is the answer, and the user's own simulation.

    **Arguments:**

    - `recording`: arrays of shape `(n,)`; t in s, the others in the units of the plant.
    - `file`: the file to write.
    """
    columns = (*COLUMNS, *(name for name in OPTIONAL if getattr(recording, name) is not None))
    table = np.column_stack([np.asarray(getattr(recording, name), float) for name in columns])
    row = ",".join(["%.9g"] * len(columns)) + "\n"
    with file.open("w", encoding="ascii", newline="") as stream:
        stream.write(",".join(columns) + "\n")
        # One `%` for thousands of rows: three times as fast as row by row.
        for start in range(0, len(table), 4096):
            chunk = table[start : start + 4096]
            stream.write((row * len(chunk)) % tuple(chunk.ravel().tolist()))
