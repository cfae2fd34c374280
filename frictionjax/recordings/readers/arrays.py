"""Files of named arrays: one table for every format that holds them."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.recordings.readers.base import AbstractColumnTable
from frictionjax.recordings.readers.extra import clean_errors
from frictionjax.recordings.words import shown

_WIDEST_MATRIX = 64
"""Columns of the widest matrix that is taken for channels; a wider one is an image."""


class ArrayTable(AbstractColumnTable):
    """The numeric vectors of a file.

    **Attributes:**

    - `path`: the file.
    - `names`: the vectors' names.
    - `columns`: name -> a function that reads the vector.
    - `refused`: name -> why what has this name is no vector of numbers, as a clause.
    - `noun`: what the format calls them: "variable", "channel", "column".
    - `units`: name -> unit, where the file has one.
    - `clocks`: name -> a function that gives the times of the samples, s, where the file has them.
    """

    path: Path = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    columns: dict[str, Callable[[], np.ndarray]] = eqx.field(static=True)
    refused: dict[str, str] = eqx.field(static=True)
    noun: str = eqx.field(static=True)
    units: dict[str, str] = eqx.field(static=True)
    clocks: dict[str, Callable[[], np.ndarray]] = eqx.field(static=True)

    def has(self, name: str) -> bool:
        return name in self.columns

    def absence(self, name: str) -> str:
        if name in self.refused:
            return f"the {self.noun} `{shown(name)}` {self.refused[name]}"
        return f"there is no {self.noun} `{shown(name)}`"

    def read(self, names: Sequence[str]) -> list[Float[np.ndarray, " _"]]:
        return [self._numbers(name) for name in names]

    def _numbers(self, name: str) -> Float[np.ndarray, " _"]:
        values = self._values(name, self.columns[name])
        if (why := not_numbers(values.dtype)) or values.ndim != 1:
            raise InputError(
                f"the {self.noun} `{shown(name)}` {why or f'has {values.ndim} dimensions, not one'}",
                file=shown(self.path, 200),
                cure="Name a vector of real numbers (columns)",
            )
        return np.ascontiguousarray(since_the_first(values), dtype=np.float64)

    def unit(self, name: str) -> str:
        return self.units.get(name, "")

    def clock(self, name: str) -> Float[np.ndarray, " _"] | None:
        read = self.clocks.get(name)
        if read is None:
            return None
        return np.ascontiguousarray(since_the_first(self._values(name, read)), dtype=np.float64)

    def _values(self, name: str, read: Callable[[], np.ndarray]) -> np.ndarray:
        problem = f"the {self.noun} `{shown(name)}` cannot be read"
        with clean_errors(self.path, problem, "Export the file again"):
            return np.asarray(read())

    def place(self, index: int) -> str:
        return f"sample {index + 1}"


class Collected:
    """The vectors of a file as they are found, and what was refused; `noun` is what the format calls a vector, `entry`
    how it writes a column of a matrix, from its name and the column's number from 0."""

    def __init__(self, noun: str, entry: Callable[[str, int], str] = "{}[:,{}]".format) -> None:
        self.noun, self.entry = noun, entry
        self.columns: dict[str, Callable[[], np.ndarray]] = {}
        self.refused: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self.clocks: dict[str, Callable[[], np.ndarray]] = {}

    def add(self, name: str, values: np.ndarray) -> None:
        """Take `values` under a `name`: a vector, a matrix column by column, or refused with the reason."""
        self.add_later(name, values.shape, values.dtype, lambda column: _part(values, column))

    def add_later(
        self, name: str, shape: tuple[int, ...], dtype: np.dtype, read: Callable[[int | None], np.ndarray]
    ) -> None:
        """The same for an array of a `name`, `shape` and `dtype` that is not read yet: `read` takes the number of a
        column, or None for a vector."""
        long = [size for size in shape if size != 1]
        if why := not_numbers(dtype):
            self.refused[name] = why
        elif not long or np.prod(shape) < 2:
            count = int(np.prod(shape))
            self.refused[name] = f"has {count} value{'s' * (count != 1)}, not a vector of samples"
        elif len(long) == 1:
            self.columns[name] = functools.partial(read, None)
        elif len(shape) == 2 and min(shape) <= _WIDEST_MATRIX:
            entries = [self.entry(name, k) for k in range(min(shape))]
            self.columns |= {entry: functools.partial(read, k) for k, entry in enumerate(entries)}
            self.refused[name] = f"is a matrix of {shape[0]} by {shape[1]}, name `{entries[0]}` or the like"
        else:
            self.refused[name] = f"has {len(long)} dimensions, not one"

    def table(self, path: Path) -> ArrayTable:
        """The table of the file `path`; `InputError` when it has no vector of numbers."""
        if not self.columns:
            raise InputError(
                f"the file contains no {self.noun} of numbers",
                file=shown(path, 200),
                cure="Save each channel as a vector of numbers",
            )
        return ArrayTable(
            path, tuple(self.columns), self.columns, self.refused, self.noun, self.units, self.clocks
        )


def _part(values: np.ndarray, column: int | None) -> np.ndarray:
    """A vector, or the numbered column of a matrix, along its longer side."""
    if column is None:
        return values.ravel()
    return values[column] if values.shape[0] < values.shape[1] else values[:, column]


def not_numbers(dtype: np.dtype) -> str:
    """Why values of a `dtype` are no real numbers, as a clause; empty when they are, or dates or durations."""
    if dtype.kind in "buifmM":
        return ""
    return (
        "holds complex numbers, not real ones" if dtype.kind == "c" else "holds text or objects, not numbers"
    )


def since_the_first(values: np.ndarray) -> np.ndarray:
    """Dates as s since the first one, durations as s; numbers as they are. Shape `(n,)`, as `values`."""
    if values.dtype.kind == "M":
        values = values - values[:1]
    if values.dtype.kind == "m":
        return np.where(np.isnat(values), np.nan, values / np.timedelta64(1, "ns") * 1e-9)
    return values
