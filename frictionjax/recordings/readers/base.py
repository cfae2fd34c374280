"""The interface of every reader: named columns, read on demand, and the place of a value in the file."""

import abc
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

import equinox as eqx
import numpy as np
from jaxtyping import Float


class AbstractColumnTable(eqx.Module):
    """An opened file of named columns of numbers.

    Opening finds the names only; a column that is not needed is never converted, so a text column does no
    harm.

    **Attributes:**

    - `path`: the file.
    - `names`: the columns' names, in the order of the file, as a message may list them.
    """

    path: eqx.AbstractVar[Path]
    names: eqx.AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def has(self, name: str) -> bool:
        """Whether there is a column of numbers called `name`."""

    @abc.abstractmethod
    def absence(self, name: str) -> str:
        """Why `has(name)` is False, as a clause: "there is no column `x`"."""

    @abc.abstractmethod
    def read(self, names: Sequence[str]) -> list[Float[np.ndarray, " _"]]:
        """The columns `names` as float64.

        **Arguments:**

        - `names`: names for which `has` is True.

        **Returns:** one 1-D array a name, in the file's units; their lengths may differ.

        **Raises:** `InputError` naming file, place and cure when a column does not contain numbers.
        """

    @abc.abstractmethod
    def unit(self, name: str) -> str:
        """The unit that the file gives for the column `name`, as text, beside the name; empty where it gives none."""

    @abc.abstractmethod
    def clock(self, name: str) -> Float[np.ndarray, " _"] | None:
        """The times of the samples of the column `name`, s, where the file has a clock for each; None: it has not."""

    @abc.abstractmethod
    def place(self, index: int) -> str:
        """Where the value `index` (from 0) of a column stands, in words: "line 17" or "sample 17"."""


@runtime_checkable
class Reader(Protocol):
    """Opens one format: `reader(path)` returns a table or raises `InputError`."""

    def __call__(self, path: Path) -> AbstractColumnTable: ...
