"""LabVIEW: `.tdms`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import clean_errors, library


def open_tdms(path: Path) -> ArrayTable:
    """Open a TDMS file.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table: channels by their names, or as `group/channel` where a name occurs twice; with their unit,
    and the clock of a waveform.

    **Raises:** `InputError` where npTDMS is absent, for a damaged file, and one without a channel of numbers.
    """
    nptdms = library("nptdms", path)
    found = Collected("channel")
    # A stream of ours is closed whatever happens.
    with (
        clean_errors(path, "is not a TDMS file that can be read", "Export it again, or as text"),
        path.open("rb") as stream,
        nptdms.TdmsFile.open(stream) as file,
    ):
        channels = [channel for group in file.groups() for channel in group.channels()]
        names = [channel.name for channel in channels]
        for channel in channels:
            group = channel.group_name
            name = channel.name if names.count(channel.name) == 1 else f"{group}/{channel.name}"
            found.add_later(
                name, (len(channel),), np.dtype(channel.dtype), _reading(path, group, channel.name)
            )
            if name not in found.columns:
                continue
            if unit := str(channel.properties.get("unit_string", "")):
                found.units[name] = unit
            if "wf_increment" in channel.properties:
                found.clocks[name] = _clock(
                    float(channel.properties.get("wf_start_offset", 0.0)),
                    float(channel.properties["wf_increment"]),
                    len(channel),
                )
    return found.table(path)


def _reading(path: Path, group: str, channel: str) -> Callable[[int | None], np.ndarray]:
    def read(_: int | None) -> np.ndarray:
        with path.open("rb") as stream, library("nptdms", path).TdmsFile.open(stream) as file:
            return np.asarray(file[group][channel][:])

    return read


def _clock(offset: float, increment: float, samples: int) -> Callable[[], np.ndarray]:
    return lambda: offset + increment * np.arange(samples)
