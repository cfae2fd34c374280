"""Measurement files of the automotive industry: ASAM MDF, `.mf4` and `.mdf`."""

import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.limits import most_bytes, too_large
from frictionjax.recordings.readers.apart import ParserEnded, ask
from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import library
from frictionjax.recordings.words import shown

_SECONDS, _PER_BYTE = 30.0, 1e-6  # s that the parser may take, beside those for each byte


def open_mf4(path: Path) -> ArrayTable:
    """Open an MDF file, of version 3 or 4, in a process of its own: a damaged one may crash the library that reads it.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table: channels by their names, or as `name (group 2)` where a name occurs twice; with their units,
    and the clock of their group.

    **Raises:** `InputError` where asammdf is absent, for a damaged file, for one that holds more than the limit, and
    one without channels.
    """
    library("asammdf", path)
    folder = _Folder()
    request = {"path": str(path.resolve()), "folder": str(folder.path), "most": most_bytes()}
    answer: dict[str, Any]
    try:
        seconds = _SECONDS + _PER_BYTE * path.stat().st_size
        answer = ask("frictionjax.recordings.readers.mf4_parser", request, seconds)
    except ParserEnded as error:
        answer = {"error": str(error)}
    if answer.get("large"):
        raise too_large(shown(path, 200), "what it holds")
    if "error" in answer:
        raise InputError(
            f"is not an MDF file that can be read ({shown(answer['error'], 80)})",
            file=shown(path, 200),
            cure="Export it again, or as text",
        )
    found = Collected("channel")
    times = Counter(channel["name"] for channel in answer["channels"])
    for channel in answer["channels"]:
        name = channel["name"]
        name = name if times[name] == 1 else f"{name} (group {channel['group'] + 1})"
        if not channel["samples"]:
            found.refused[name] = "holds text or objects, not numbers"
            continue
        found.columns[name] = _reading(folder, channel["samples"])
        found.clocks[name] = _reading(folder, channel["times"])
        if channel["unit"]:
            found.units[name] = channel["unit"]
    return found.table(path)


class _Folder:
    """A temporary folder, the `path`, for as long as a column may be read from it."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="frictionjax-"))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


def _reading(folder: _Folder, file: str) -> Callable[[], np.ndarray]:
    return lambda: np.load(folder.path / file, allow_pickle=False)
