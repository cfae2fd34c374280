"""Which cases a study computes: a factorial design takes every combination, a random or Sobol one fills ranges."""

import abc
import dataclasses
import hashlib
import inspect
import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from jaxtyping import Int, Shaped

from frictionjax.core import InputError
from frictionjax.studies.axes import Axis

CaseColumns = Mapping[str, Shaped[np.ndarray, " n"]]
"""The values of cases by the name of the axis, shape `(n,)` each."""

MOST_CASES = 2**32 - 1
"""The random numbers of a case are numbered by 32 bits."""


class AbstractDesign(abc.ABC):
    """Which cases a study computes, in which order, and how they become dimensions of its result."""

    if TYPE_CHECKING:  # it can only be read: a field of a frozen dataclass

        @property
        def axes(self) -> tuple[Axis, ...]: ...
    else:
        axes: tuple[Axis, ...]

    @property
    @abc.abstractmethod
    def shape(self) -> dict[str, int]:
        """Name and length of each dimension of the result; the cases lie in it, the last dimension fastest."""

    @abc.abstractmethod
    def table(self) -> "AbstractCaseTable":
        """The cases as a table of values."""

    def streams(self, places: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """The number of the random numbers of the cases at `places`, shape `(n,)`: by default their place itself."""
        return places

    @property
    def size(self) -> int:
        """Number of cases."""
        return math.prod(self.shape.values())

    def described(self) -> dict[str, Any]:
        """What it is, in the types of JSON."""
        rest = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "axes"}  # type: ignore[arg-type]
        return {"kind": type(self).__name__, "axes": [axis.described() for axis in self.axes], **rest}


class AbstractCaseTable(abc.ABC):
    """The values of every case of a design."""

    @abc.abstractmethod
    def take(self, places: Int[np.ndarray, " n"]) -> CaseColumns:
        """The values of the cases at `places`, shape `(n,)`."""

    @abc.abstractmethod
    def coordinates(self) -> dict[str, tuple[str, Shaped[np.ndarray, " _"]]]:
        """Name -> (dimension, values) of what labels the result."""


@dataclasses.dataclass(frozen=True, init=False)
class Factorial(AbstractDesign):
    """Every combination of the values of the axes, each computed `repeats` times.

    The result has a dimension for each axis, and `repeat`.

    **Arguments:**

    - `axes`: each an `Axis` with values, or with a range and a `count`.
    - `repeats`: how often each combination is computed, each time with random numbers of its own.
    - `same_draws`: whether all combinations of one repeat share their random numbers. Differences between them are then
        more accurate, and no longer independent.
    """

    axes: tuple[Axis, ...]
    repeats: int
    same_draws: bool

    def __init__(self, *axes: Axis, repeats: int = 1, same_draws: bool = False) -> None:
        _set(self, axes, "repeats", repeats)
        object.__setattr__(self, "same_draws", bool(same_draws))
        for axis in axes:
            axis.levels()
        _check_size(self)

    @property
    def shape(self) -> dict[str, int]:
        """The axes, then `repeat`."""
        return {axis.name: len(axis.levels()) for axis in self.axes} | {"repeat": self.repeats}

    def table(self) -> "GridTable":
        """The combinations, which are made when they are asked for."""
        return GridTable(tuple((axis.name, axis.levels()) for axis in self.axes), self.repeats)

    def streams(self, places: Int[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """The place, shape `(n,)`; with `same_draws` the repeat at `places`."""
        return places % self.repeats if self.same_draws else places


@dataclasses.dataclass(frozen=True)
class GridTable(AbstractCaseTable):
    """The combinations of `levels`, (name, values) of each axis, with so many `repeats`."""

    levels: tuple[tuple[str, Shaped[np.ndarray, " _"]], ...]
    repeats: int

    def take(self, places: Int[np.ndarray, " n"]) -> CaseColumns:
        """The combinations at `places`, shape `(n,)`."""
        shape = [len(values) for _, values in self.levels] + [self.repeats]
        index = np.unravel_index(places, shape)
        return {name: values[index[k]] for k, (name, values) in enumerate(self.levels)}

    def coordinates(self) -> dict[str, tuple[str, Shaped[np.ndarray, " _"]]]:
        """The values of each axis, and the number of each repeat."""
        return {name: (name, values) for name, values in self.levels} | {
            "repeat": ("repeat", np.arange(self.repeats))
        }


@dataclasses.dataclass(frozen=True)
class CaseTable(AbstractCaseTable):
    """The `values` of each case by the name of the axis, shape `(n,)` each."""

    values: CaseColumns

    def take(self, places: Int[np.ndarray, " n"]) -> CaseColumns:
        """The values at `places`, shape `(n,)`."""
        return {name: column[places] for name, column in self.values.items()}

    def coordinates(self) -> dict[str, tuple[str, Shaped[np.ndarray, " _"]]]:
        """The number of each case, and its values."""
        count = len(next(iter(self.values.values())))
        return {"case": ("case", np.arange(count))} | {
            name: ("case", column) for name, column in self.values.items()
        }


@dataclasses.dataclass(frozen=True, init=False)
class RandomDesign(AbstractDesign):
    """Cases drawn independently from the ranges, or the lists, of the axes.

    The result has the dimension `case`, with the axes as coordinates.

    **Arguments:**

    - `axes`: each an `Axis`.
    - `cases`: how many are drawn.
    - `design_seed`: of the draws; the random numbers within the cases follow the seed of the study.
    """

    axes: tuple[Axis, ...]
    cases: int
    design_seed: int

    def __init__(self, *axes: Axis, cases: int, design_seed: int = 0) -> None:
        _set(self, axes, "cases", cases)
        object.__setattr__(self, "design_seed", int(design_seed))
        _need_axes(self)
        _check_size(self)

    @property
    def shape(self) -> dict[str, int]:
        """`case`."""
        return {"case": self.cases}

    def table(self) -> CaseTable:
        """The values that are drawn."""
        rng = np.random.default_rng(self.design_seed)
        return _table(self.axes, rng.random((self.cases, len(self.axes))))


@dataclasses.dataclass(frozen=True, init=False)
class SobolDesign(AbstractDesign):
    """Cases that fill the ranges of the axes evenly: a scrambled Sobol sequence. Means over it converge faster than
    over random cases; a power of two keeps it balanced.

    The result has the dimension `case`, with the axes as coordinates.

    **Arguments:**

    - `axes`: each an `Axis`.
    - `cases`: how many are taken.
    - `design_seed`: of the scrambling; the random numbers within the cases follow the seed of the study.
    """

    axes: tuple[Axis, ...]
    cases: int
    design_seed: int

    def __init__(self, *axes: Axis, cases: int, design_seed: int = 0) -> None:
        _set(self, axes, "cases", cases)
        object.__setattr__(self, "design_seed", int(design_seed))
        _need_axes(self)
        _check_size(self)

    @property
    def shape(self) -> dict[str, int]:
        """`case`."""
        return {"case": self.cases}

    def table(self) -> CaseTable:
        """The values of the sequence."""
        # The name of the argument differs between versions of scipy.
        seed = "rng" if "rng" in inspect.signature(scipy.stats.qmc.Sobol).parameters else "seed"
        random: dict[str, Any] = {seed: self.design_seed}
        sequence = scipy.stats.qmc.Sobol(len(self.axes), scramble=True, **random)
        return _table(self.axes, sequence.random_base2(max(self.cases - 1, 1).bit_length())[: self.cases])


def digest(design: AbstractDesign) -> str:
    """A digest of the values of every case of a `design`: two designs with the same one have the same cases."""
    found = hashlib.sha256(json.dumps(design.shape).encode())
    for name, (dimension, values) in design.table().coordinates().items():
        found.update(f"{name} {dimension} ".encode())
        found.update(repr(list(values)).encode() if values.dtype == object else values.tobytes())
    return found.hexdigest()[:16]


def _table(axes: tuple[Axis, ...], parts: Shaped[np.ndarray, "n k"]) -> CaseTable:
    return CaseTable({axis.name: axis.at(parts[:, k]) for k, axis in enumerate(axes)})


def _set(design: AbstractDesign, axes: tuple[Axis, ...], name: str, count: int) -> None:
    for place, axis in enumerate(axes):
        if not isinstance(axis, Axis):
            raise InputError(
                f"argument {place + 1} is a {type(axis).__name__}",
                place=type(design).__name__,
                cure='Give axes, such as Axis("noise", [1e-7, 1e-6], unit="m")',
            )
    names = [axis.name for axis in axes]
    if twice := {axis for axis in names if names.count(axis) > 1}:
        raise InputError(
            f"there are two axes `{twice.pop()}`", place=type(design).__name__, cure="Rename one of them"
        )
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise InputError(
            f"`{name}` is {count!r}", place=type(design).__name__, cure="Give a whole number from 1 on"
        )
    object.__setattr__(design, "axes", tuple(axes))
    object.__setattr__(design, name, count)


def _need_axes(design: AbstractDesign) -> None:
    if not design.axes:
        raise InputError("there is no axis", place=type(design).__name__, cure="Give one or more")


def _check_size(design: AbstractDesign) -> None:
    if design.size > MOST_CASES:
        raise InputError(
            f"the design has {design.size} cases, and a study at most {MOST_CASES}",
            place=type(design).__name__,
            cure="Take fewer values or repeats, or a random design",
        )
