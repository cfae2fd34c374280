"""`Study`: what is computed, for which cases, with which random numbers; and how its cases are grouped."""

import dataclasses
import platform
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from frictionjax.core import InputError
from frictionjax.core.json import plain_json
from frictionjax.studies.design import AbstractCaseTable, AbstractDesign, digest
from frictionjax.studies.task import AbstractTask, Block, as_task

FORMAT = 1
"""Version of what a store holds; raised when older programs could no longer read it."""


@dataclasses.dataclass(frozen=True, init=False)
class Study:
    """A design, and what is done with each of its cases: run it by `run_study`.

    The random numbers of a case follow from `seed` and its place in the design alone.

    **Arguments:**

    - `design`: a `Factorial`, `RandomDesign` or `SobolDesign`.
    - `task`: a task, or a function that JAX can compile: `function(key, **case)` returns a mapping of names to numbers
        and arrays, see `CompiledTask`.
    - `seed`: of the random numbers, a whole number below 2^32.
    """

    design: AbstractDesign
    task: AbstractTask
    seed: int

    def __init__(
        self, design: AbstractDesign, task: AbstractTask | Callable[..., Mapping[str, Any]], *, seed: int = 0
    ) -> None:
        if not isinstance(design, AbstractDesign):
            raise InputError(
                f"a {type(design).__name__} is no design", place="`design`", cure="Give a Factorial, say"
            )
        if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**32:
            raise InputError(f"`seed` is {seed!r}", cure="Give a whole number from 0 to 2^32 - 1")
        object.__setattr__(self, "design", design)
        object.__setattr__(self, "task", as_task(task))
        object.__setattr__(self, "seed", seed)
        self.task.check(tuple(axis.name for axis in design.axes))

    def described(self) -> dict[str, Any]:
        """The design, the task and the seed, in the types of JSON: a store of another study is refused."""
        return plain_json(
            {
                "format": FORMAT,
                "design": self.design.described() | {"digest": digest(self.design)},
                "task": self.task.described(),
                "seed": self.seed,
            }
        )


def versions() -> dict[str, str]:
    """What computed the numbers: versions of the libraries, and the kind of processor."""
    found = {name: version(name) for name in ("frictionjax", "jax", "jaxlib", "numpy", "scipy")}
    return found | {"python": platform.python_version(), "machine": platform.machine()}


class Blocks:
    """The cases of a `study` in the groups that one call computes, in a fixed order that the design alone decides.

    A group has up to `lanes` cases, all of which have the same texts.
    """

    def __init__(self, study: Study) -> None:
        self._study = study
        self._table: AbstractCaseTable = study.design.table()
        self._lanes = study.task.lanes
        texts = [axis.name for axis in study.design.axes if axis.values and isinstance(axis.values[0], str)]
        self._order: Int[np.ndarray, " n"] | None = None
        sizes = [study.design.size]
        if texts and self._lanes > 1:
            columns = self._table.take(np.arange(study.design.size))
            kinds: Int[np.ndarray, " n"] = np.zeros(study.design.size, int)
            for name in texts:
                found, own = np.unique(columns[name].astype(str), return_inverse=True)
                kinds = kinds * len(found) + own
            self._order = np.argsort(kinds, kind="stable")
            sizes = np.unique(kinds, return_counts=True)[1].tolist()
        # First place, in the order, of each block, and the end of the last.
        ends, first = [], 0
        for size in sizes:
            ends.append(np.arange(first, first + size, self._lanes))
            first += size
        self._edges = np.append(np.concatenate(ends), first)

    def __len__(self) -> int:
        return len(self._edges) - 1

    def places(self, numbers: Int[np.ndarray, " k"]) -> Int[np.ndarray, " n"]:
        """The cases of the blocks with these `numbers`, shape `(k,)`, by their places in the design, shape `(n,)`."""
        parts = [np.arange(int(self._edges[k]), int(self._edges[k + 1])) for k in numbers]
        places = np.concatenate(parts) if parts else np.zeros(0, int)
        return places if self._order is None else self._order[places]

    def sizes(self) -> Int[np.ndarray, " k"]:
        """Number of cases of each block, shape `(k,)`."""
        return np.diff(self._edges)

    def unfinished(self, done: Bool[np.ndarray, " n"]) -> Int[np.ndarray, " k"]:
        """The numbers of the blocks that have a case which is not `done`, shape `(n,)` in the order of the design."""
        ordered = done if self._order is None else done[self._order]
        missing = np.add.reduceat(~ordered, self._edges[:-1])
        return np.flatnonzero(missing)

    def take(self, numbers: Int[np.ndarray, " k"]) -> list[Block]:
        """The blocks with these `numbers`, shape `(k,)`."""
        return list(self._blocks(numbers))

    def _blocks(self, numbers: Int[np.ndarray, " k"]) -> Iterator[Block]:
        for number in numbers:
            places = self.places(np.asarray([number]))
            yield Block(places, self._study.design.streams(places), self._table.take(places))
