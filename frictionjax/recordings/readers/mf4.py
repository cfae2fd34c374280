"""Measurement files of the automotive industry: ASAM MDF, `.mf4` and `.mdf`."""

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.readers.apart import ParserEnded, ask
from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import library
from frictionjax.recordings.words import shown

# s that the parser may take, and those for each byte beside them: longer, and a file that keeps it busy for ever is
# waited for; shorter, and a busy machine refuses a sound one. By hand; it starts in two to five.
_SECONDS, _PER_BYTE = 30.0, 1e-6


def open_mf4(path: Path) -> ArrayTable:
    """Open an MDF file, of version 3 or 4, in a process of its own: a damaged one may crash the library that reads it.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table: channels by their names, or as `name (group 2)` where a name occurs twice; with their units,
    and the clock of their group.

    **Raises:** `InputError` where asammdf is absent, for a damaged file, and one without channels.
    """
    library("asammdf", path)
    channels, found = _answer(path, {})["channels"], Collected("channel")
    times = Counter(channel["name"] for channel in channels)
    for channel in channels:
        name = channel["name"]
        name = name if times[name] == 1 else f"{name} (group {channel['group'] + 1})"
        place = {"group": channel["group"], "index": channel["index"]}
        found.columns[name] = _reading(path, place | {"clock": False})
        found.clocks[name] = _reading(path, place | {"clock": True})
        if channel["unit"]:
            found.units[name] = channel["unit"]
    return found.table(path)


def _reading(path: Path, wanted: dict[str, Any]) -> Callable[[], np.ndarray]:
    def read() -> np.ndarray:
        with tempfile.TemporaryDirectory(prefix="frictionjax-") as folder:
            values = Path(folder) / "values.npy"
            _answer(path, wanted | {"values": str(values)})
            return np.load(values, allow_pickle=False)

    return read


def _answer(path: Path, wanted: dict[str, Any]) -> dict[str, Any]:
    """The parser's answer for what is `wanted` of the file `path`."""
    try:
        seconds = _SECONDS + _PER_BYTE * path.stat().st_size
        request = {"path": str(path.resolve()), **wanted}
        answer = ask("frictionjax.recordings.readers.mf4_parser", request, seconds)
    except ParserEnded as error:
        answer = {"error": str(error)}
    if "error" in answer:
        raise InputError(
            f"is not an MDF file that can be read ({shown(answer['error'], 80)})",
            file=shown(path, 200),
            cure="Export it again, or as text",
        )
    return answer
