"""What a user gives a fit: data in many forms, and what the case of these data already knows of the machine."""

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from frictionjax.core import InputError
from frictionjax.estimation.data.observation import Observation
from frictionjax.frequency import FRF
from frictionjax.physics import Drive
from frictionjax.recordings import Case, Plant, Recording, load_case
from frictionjax.recordings.frame import Frame, is_frame
from frictionjax.recordings.given import is_case_file, recordings_of, whole_recording
from frictionjax.recordings.units import turn_of

DataPiece = Recording | FRF | Observation
"""One piece of data for a fit."""

Data = Case | str | Path | Frame | DataPiece | Sequence[str | Path | Frame | DataPiece]
"""A `Case`, of which the recordings to fit are taken; the path of a case file or of a recording; named columns in
memory; a `Recording`, an `FRF` or an `Observation`; several of these."""

_KINDS = (
    "Give a `Case`, the path of a case file or of a recording, a DataFrame, a `Recording`, an `FRF`, an `Observation`, "
    "or a list of these."
)
_UNITS = {"force": "force_unit", "position": "position_unit", "input": "input_unit"}


def pieces_of(data: Data) -> tuple[DataPiece, ...]:
    """The pieces that `data` stands for; held-out recordings of a case are not among them.

    **Raises:** `InputError` for anything that is no data, and as `load_case` does.
    """
    if is_case_file(data):
        data = load_case(data)
    if isinstance(data, Case):
        return data.fit_recordings
    single = isinstance(data, str | Path | DataPiece) or is_frame(data)
    items: Sequence[Any] = [data] if single else data if isinstance(data, Sequence) else [None]
    pieces: list[DataPiece] = []
    for item in items:
        if isinstance(item, Recording | FRF | Observation):
            pieces.append(item)
        elif isinstance(item, str | Path):
            pieces.append(whole_recording(item))
        elif is_frame(item):
            pieces += recordings_of([item])
        else:
            wrong = data if item is None else item
            raise InputError(f"{type(wrong).__name__} is no data for a fit", place="`data`", cure=_KINDS)
    return tuple(pieces)


def plant_of(pieces: Sequence[DataPiece]) -> Plant | None:
    """The machine of the `pieces`, as their cases describe it; None where no case describes it.

    **Raises:** `InputError` where two of them are described differently.
    """
    data = [piece.data if isinstance(piece, Observation) else piece for piece in pieces]
    plants = [one.plant for one in data if isinstance(one, Recording) and one.plant is not None]
    for other in plants:
        for name in ("motor_constant", "inertia", *_UNITS.values()):
            first, second = getattr(plants[0], name), getattr(other, name)
            if first != second:
                raise InputError(
                    f"the recordings are of machines with {name} = {first} and {name} = {second}",
                    place="`data`",
                    cure="Fit the recordings of one machine at a time, or correct its case.",
                )
    return plants[0] if plants else None


def units_of(plant: Plant | None) -> dict[str, str]:
    """The names of the units of a `plant` by kind; "force", "position" and "input" where nothing is known of it."""
    return {kind: getattr(plant or Plant(), name) for kind, name in _UNITS.items()}


def keeps_inertia(plant: Plant | None, asked: bool | None, free: Collection[str]) -> bool:
    """Whether J is known: as `asked`, or else as the `plant` says, unless J is among the parameters asked for by name,
    `free`."""
    if asked is not None:
        return asked
    return plant is not None and plant.inertia is not None and "J" not in free


def require_agreement(drive: Drive, plant: Plant | None, *, motor_constant: bool, inertia: bool) -> None:
    """Raise the `InputError` for a `drive` that contradicts its `plant`: in the `motor_constant`, and in the `inertia`,
    where these are to be kept, and in the turn of an angle, in the unit of the positions."""
    if plant is None:
        return
    turn = turn_of(plant.position_unit)
    for effect in drive.effects:
        own = float(getattr(effect, "turn", turn or 0.0))
        if turn is not None and not math.isclose(own, turn):
            raise InputError(
                f"{effect.name} has a full turn of {own:.6g}, and one in {plant.position_unit} is {turn:.6g}",
                place="`drive`",
                cure=f"Make the effect with turn={turn!r}, or correct the unit of the case.",
            )
    known = {"motor_constant": plant.motor_constant} if motor_constant else {}
    known |= {"J": plant.inertia} if inertia else {}
    for name, right in known.items():
        value = float(getattr(drive, name))
        if right is None or math.isclose(value, right):
            continue
        key = {"J": "inertia"}.get(name, name)
        off = f", {max(value / right, right / value):.3g} times as much or as little" if value > 0.0 else ""
        raise InputError(
            f"{name} is {value:.6g}, and the case of the data has {key} = {right:.6g}{off}",
            place="`drive`",
            cure=f"Make the drive with {name}={right!r}, or correct the case.",
        )
