"""What a user may give in place of a case: a path, recordings, or tables in memory."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeGuard

from frictionjax.core import InputError
from frictionjax.recordings.case import case_from_files, load_case
from frictionjax.recordings.columns import SHOWN
from frictionjax.recordings.frame import Frame, is_frame, recording_from_frame, recording_from_table
from frictionjax.recordings.hold_out import hold_out_last_third
from frictionjax.recordings.readers import open_table, stem
from frictionjax.recordings.recording import Case, Plant, Recording
from frictionjax.recordings.schema import PLANT_KEYS
from frictionjax.recordings.words import require_file

CaseData = Case | str | Path | Recording | Frame | Sequence[str | Path] | Sequence[Recording | Frame]
"""A `Case`; the path of a case file or of a recording; a `Recording`; named columns in memory; several of one kind."""

_KINDS = "Give a `Case`, the path of a case file or of a recording, a DataFrame, a `Recording`, or a list of recordings"


def case_of(data: object, *, plant: Plant | None = None, place: str = "`case`") -> Case:
    """The case that `data` stands for.

    **Arguments:**

    - `data`: see `CaseData`. Of a single recording, the last third is held out, with a warning.
    - `plant`: what is known of the machine, where `data` does not say it.
    - `place`: the argument that `data` came by, for messages.

    **Returns:** the `Case`.

    **Raises:** `InputError` for anything else, for a `plant` beside a case that has its own, and as `load_case` does.
    """
    if isinstance(data, Case):
        return _without(plant, data, f"the case {data.name}")
    if is_case_file(data):
        return _without(plant, load_case(data), f'the case file "{data}"')
    if isinstance(data, str | Path):
        return _from_files([data], plant)
    if isinstance(data, Recording):
        return _from_recordings([data], plant)
    if is_frame(data):
        return _from_recordings([recording_from_frame(data, plant=plant)], plant)  # type: ignore[arg-type]
    items = list(data) if isinstance(data, Sequence) else []
    if items and all(isinstance(item, str | Path) for item in items):
        return _from_files(items, plant)  # type: ignore[arg-type]
    if not items or not all(isinstance(item, Recording) or is_frame(item) for item in items):
        raise InputError(f"{_kind(data)} is not a case", place=place, cure=_KINDS)
    return _from_recordings(recordings_of(items, plant), plant)


def recordings_of(items: Sequence[Any], plant: Plant | None = None) -> list[Recording]:
    """The recordings among `items`, and those that are made of its tables in memory, with the `plant`."""
    made: list[Recording] = []
    for item in items:
        if isinstance(item, Recording):
            made.append(item)
            continue
        name = "recording" if not made else f"recording_{len(made) + 1}"
        made.append(recording_from_frame(item, name=name, plant=plant))
    return made


def is_case_file(data: object) -> TypeGuard[str | Path]:
    """Whether `data` is the path of a case file, by its suffix."""
    return isinstance(data, str | Path) and Path(data).suffix.lower() == ".toml"


def whole_recording(path: str | Path, plant: Plant | None = None) -> Recording:
    """The recording in the file `path`, nothing of it held out, with the `plant`."""
    file = require_file(Path(path))
    return recording_from_table(open_table(file), stem(file), plant)


def _from_files(paths: Sequence[str | Path], plant: Plant | None) -> Case:
    if plant is None:
        return case_from_files(list(paths))
    case = case_from_files(list(paths), **{name: getattr(plant, name) for name in PLANT_KEYS})
    shown = {name: getattr(plant, name) for name in SHOWN.values()}
    return (
        dataclasses.replace(case, plant=dataclasses.replace(case.plant, **shown))
        if any(shown.values())
        else case
    )


def _from_recordings(recordings: list[Recording], plant: Plant | None) -> Case:
    plants = [one.plant for one in recordings if one.plant is not None]
    if plant is None:
        plant = plants[0] if plants else Plant()
    if any(other != plant for other in plants):
        raise InputError(
            "the recordings are of machines that are described differently",
            place="`plant`",
            cure="Give recordings of one machine, or make a `Case` with the plant that holds for all of them",
        )
    case = Case(recordings[0].name, plant, tuple(recordings))
    return hold_out_last_third(case) if len(recordings) == 1 else case


def _without(plant: Plant | None, case: Case, what: str) -> Case:
    if plant is not None and plant != case.plant:
        raise InputError(
            f"{what} describes its machine, and another `plant` is given",
            place="`plant`",
            cure="Leave `plant` out, or change the case: dataclasses.replace(case, plant=plant)",
        )
    return case


def _kind(data: object) -> str:
    if isinstance(data, Sequence):
        return "an empty list" if not data else f"a list of {type(data[0]).__name__}"
    return f"a {type(data).__name__}"
