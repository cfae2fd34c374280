"""Measurement files of the automotive industry: ASAM MDF, `.mf4` and `.mdf`."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import clean_errors, library


def open_mf4(path: Path) -> ArrayTable:
    """Open an MDF file, of version 3 or 4.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table: channels by their names, or as `name (group 2)` where a name occurs twice; with their units,
    and the clock of their group.

    **Raises:** `InputError` where asammdf is absent, for a damaged file, and one without channels.
    """
    asammdf = library("asammdf", path)
    found = Collected("channel")
    # A stream of ours is closed whatever happens.
    with (
        clean_errors(path, "is not an MDF file that can be read", "Export it again, or as text"),
        path.open("rb") as stream,
        asammdf.MDF(stream) as file,
    ):
        places = [
            (channel.name, group, index)
            for group, content in enumerate(file.groups)
            for index, channel in enumerate(content.channels)
            if file.masters_db.get(group) != index
        ]
        times = Counter(name for name, _, _ in places)
        for channel, group, index in places:
            name = channel if times[channel] == 1 else f"{channel} (group {group + 1})"
            found.columns[name] = _reading(path, group, index, clock=False)
            found.clocks[name] = _reading(path, group, index, clock=True)
            if unit := str(file.get_channel_unit(group=group, index=index) or ""):
                found.units[name] = unit
    return found.table(path)


def _reading(path: Path, group: int, index: int, *, clock: bool) -> Callable[[], np.ndarray]:
    def read() -> np.ndarray:
        with path.open("rb") as stream, library("asammdf", path).MDF(stream) as file:
            signal = file.get(group=group, index=index)
            return np.asarray(signal.timestamps if clock else signal.samples)

    return read
