"""Recordings from what Python holds in memory: a DataFrame, a Dataset, or a mapping of names to arrays."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.recordings.channels import make_recording
from frictionjax.recordings.columns import find_columns, labelled
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.recording import Plant, Recording
from frictionjax.recordings.schema import Spot, parse_entry
from frictionjax.recordings.words import listed, shown


@runtime_checkable
class Frame(Protocol):
    """Named columns in memory: a DataFrame of pandas or polars, a Dataset of xarray, or a mapping of names to arrays.

    Columns are asked for by `name`.
    """

    def __getitem__(self, name: Any, /) -> Any: ...

    def __iter__(self) -> Iterator[Any]: ...


class FrameTable(AbstractColumnTable):
    """The columns of a `Frame`; the index of a DataFrame, where it has a name, is one of them."""

    path: Path = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    columns: dict[str, Any]

    def has(self, name: str) -> bool:
        return name in self.columns

    def absence(self, name: str) -> str:
        return f"there is no column `{shown(name)}`"

    def read(self, names: Sequence[str]) -> list[Float[np.ndarray, " _"]]:
        return [self._numbers(name) for name in names]

    def unit(self, name: str) -> str:
        return str(getattr(self.columns[name], "attrs", {}).get("units", ""))

    def clock(self, name: str) -> None:
        return None

    def place(self, index: int) -> str:
        return f"row {index}"

    def _numbers(self, name: str) -> Float[np.ndarray, " _"]:
        values = np.asarray(self.columns[name])
        if values.dtype.kind == "M":  # a calendar counts from its first instant
            values = values - values[:1]
        if values.dtype.kind == "m":
            return values / np.timedelta64(1, "s")
        if values.ndim != 1 or values.dtype.kind not in "buif":
            kind = (
                f"has the shape {values.shape}" if values.ndim != 1 else f"holds {values.dtype}, not numbers"
            )
            raise InputError(
                f"the column `{shown(name)}` {kind}",
                file=self.path,
                cure="Give one number a row; the columns are: " + listed(self.names),
            )
        return values.astype(np.float64)


def is_frame(value: object) -> bool:
    """Whether `value` is a table of named columns, as a `Frame`."""
    return isinstance(value, Mapping) or hasattr(value, "columns") or hasattr(value, "variables")


def recording_from_frame(
    frame: Frame,
    *,
    name: str = "recording",
    role: str = "fit",
    sample_rate: float | None = None,
    plant: Plant | None = None,
    loop: str | None = None,
    drive: str | None = None,
    start_time: float | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    interval: tuple[float, float] | None = None,
) -> Recording:
    """A recording from named columns in memory, read and checked like a file of them.

    **Arguments:**

    - `frame`: a DataFrame of pandas or polars, a Dataset of xarray, or a mapping of names to arrays. Times may be
        numbers in s, dates, or the index of the DataFrame where that is called `t`.
    - `name`: of the recording.
    - `role`: `"fit"` or `"holdout"`.
    - `sample_rate`: Hz, where there is no column of time.
    - `plant`: what is known of the machine.
    - `loop`, `drive`, `start_time` (s), `columns`, `units`, `scale`, `interval` (s): as in a case file. Columns that
        carry their unit (`attrs["units"]` of xarray and pandas, or in their name) need no entry in `units`.

    **Returns:** the `Recording`, with what the audit found among its `warnings`.

    **Raises:** `InputError` for a column that is missing or holds no numbers, and for whatever makes a file unusable.
    Warns with `FrictionjaxWarning` where it had to be resampled.
    """
    known = {"role": role, "sample_rate": sample_rate, "loop": loop, "drive": drive, "start_time": start_time}
    known |= {"interval": interval, "columns": None if columns is None else dict(columns)}
    known |= {"units": None if units is None else dict(units)}
    known |= {"scale": None if scale is None else dict(scale)}
    return recording_from_table(table_of(frame, name), name, plant, **known)


def table_of(frame: object, name: str) -> FrameTable:
    """The named columns of a `frame` in memory as a table called `name`.

    **Raises:** `InputError` for what has no named columns.
    """
    held = _columns(frame)
    return FrameTable(Path(name), tuple(held), held)


def recording_from_table(
    table: AbstractColumnTable, name: str, plant: Plant | None, **known: Any
) -> Recording:
    """The recording called `name` in an opened `table`, of the `plant`; `known`: keys of a case file's recording."""
    entry = parse_entry({"file": name, **known}, Spot(None))
    chosen = find_columns(entry, table)
    made = make_recording(entry, table, chosen, name, labelled(plant or Plant(), chosen, entry))
    return made if plant is None else dataclasses.replace(made, plant=plant)


def _columns(frame: Any) -> dict[str, Any]:
    """The columns of a `frame` by their names as text, the named index of a DataFrame first."""
    if not is_frame(frame):
        raise InputError(
            f"a {type(frame).__name__} has no named columns",
            place="`frame`",
            cure="Give a DataFrame, a Dataset, or a mapping of names to arrays",
        )
    names = list(getattr(frame, "variables", getattr(frame, "columns", frame)))
    held = {str(name): frame[name] for name in names}
    index = getattr(frame, "index", None)
    label = getattr(index, "name", None)
    return held if label is None or str(label) in held else {str(label): index, **held}
