"""What a study does with each case: an abstract task, and the two for functions of the user's own."""

import abc
import dataclasses
import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int, Shaped

from frictionjax.core import InputError
from frictionjax.core.forks import require_own_threads
from frictionjax.studies.design import CaseColumns

Values = dict[str, Shaped[np.ndarray, "_ ..."]]
"""The results of cases by name; the cases are the leading axis."""


class Block(NamedTuple):
    """Cases that are computed together.

    **Attributes:**

    - `places`: where they stand in the design, shape `(n,)`.
    - `streams`: the number of the random numbers of each, shape `(n,)`.
    - `columns`: the values of each by the name of the axis, shape `(n,)`.
    """

    places: Int[np.ndarray, " n"]
    streams: Int[np.ndarray, " n"]
    columns: CaseColumns


class Outcome(NamedTuple):
    """What came of a `Block`: the `values` of its cases, and why each of them failed, or the empty text (`reasons`)."""

    values: Values
    reasons: list[str]


class AbstractTask(abc.ABC):
    """What a study does with each case; its fields are what a store of results says of it.

    **Attributes:**

    - `lanes`: how many cases one call computes side by side. It decides how cases are grouped, and with it the last
        bits of their results; how they are distributed over chunks, processes and devices does not.
    - `units`: name of a result -> its unit.
    - `dims`: name of a result that is an array -> names of its axes.
    """

    if TYPE_CHECKING:  # they can only be read: fields of a frozen dataclass, or properties

        @property
        def lanes(self) -> int: ...
        @property
        def units(self) -> Mapping[str, str]: ...
        @property
        def dims(self) -> Mapping[str, tuple[str, ...]]: ...
    else:
        lanes: int
        units: Mapping[str, str]
        dims: Mapping[str, tuple[str, ...]]

    @abc.abstractmethod
    def compute(self, seed: int, block: Block) -> Outcome:
        """Compute the cases of a `block` with random numbers that follow from `seed` and their numbers alone."""

    @abc.abstractmethod
    def described(self) -> dict[str, Any]:
        """What it is, in the types of JSON."""

    @abc.abstractmethod
    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where it cannot take the `axes`, by name."""

    @property
    def on_devices(self) -> bool:
        """Whether a block is computed on one device, so that several devices compute several blocks."""
        return False


@dataclasses.dataclass(frozen=True)
class CompiledTask(AbstractTask):
    """A function that JAX compiles: `function(key, **case)` returns a mapping of names to numbers and arrays.

    It is compiled once, for `lanes` cases side by side (`jax.vmap`). Numbers and booleans arrive as JAX scalars; texts
    arrive as they are, and each combination of them is compiled on its own. A case with a number that is not finite, or
    whose result `converged` is False, counts as failed, and its numbers are kept.

    **Attributes:**

    - `function`: of a key of `jax.random` and the axes as keywords. For other processes it must stand at the top of a
        module, or cloudpickle must be installed.
    - `units`: name of a result -> its unit.
    - `dims`: name of a result that is an array -> names of its axes.
    - `lanes`: cases in one call: 64 fill the vector units of a processor, a GPU needs thousands.
    - `may_be_infinite`: names of results that need not be finite.
    """

    function: Callable[..., Mapping[str, Any]]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    dims: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    lanes: int = 64
    may_be_infinite: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.lanes < 1:
            raise InputError(f"`lanes` is {self.lanes}", cure="Compute one case at a time or more")

    @property
    def on_devices(self) -> bool:
        """True: JAX computes a block where it is asked to."""
        return True

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `function` does not take the `axes`."""
        check_arguments(self.function, "key", axes)

    def described(self) -> dict[str, Any]:
        """The name of the function, and `lanes`."""
        return {"kind": "CompiledTask", "function": name_of(self.function), "lanes": self.lanes}

    def compute(self, seed: int, block: Block) -> Outcome:
        """One call of the compiled function for a `block` of at most `lanes` cases; `seed` as in `AbstractTask`."""
        require_own_threads()
        texts = {n: str(c[0]) for n, c in block.columns.items() if c.dtype == object}
        numbers = {n: c for n, c in block.columns.items() if c.dtype != object}
        program = functools.partial(_program(self.function, tuple(sorted(texts.items()))), np.uint32(seed))
        count = len(block.places)
        # The last block is filled up with its last case, so that one compiled program serves them all.
        filled = np.minimum(np.arange(self.lanes), count - 1)
        streams = block.streams[filled].astype(np.uint32)
        numbers = {name: column[filled] for name, column in numbers.items()}
        try:
            found = jax.device_get(program(streams, numbers))
        except jax.errors.JaxRuntimeError as error:
            if _is_of_the_machine(error):
                raise
            return self._one_by_one(program, streams, numbers, count)
        values = {name: np.asarray(value)[:count] for name, value in found.items()}
        return Outcome(values, self._reasons(values, count))

    def _one_by_one(self, program: Callable, streams: Any, numbers: dict[str, Any], count: int) -> Outcome:
        """A case has raised an error, and all of its block with it: each is computed in its own lane, with copies of it
        in the others."""
        parts: list[Values | None] = []
        reasons: list[str] = []
        for lane in range(count):
            same = np.full(self.lanes, lane)
            try:
                found = jax.device_get(program(streams[same], {n: c[same] for n, c in numbers.items()}))
            except jax.errors.JaxRuntimeError as error:
                if _is_of_the_machine(error):
                    raise
                parts.append(None)
                reasons.append(one_line(error))
                continue
            own = {name: np.asarray(value)[lane : lane + 1] for name, value in found.items()}
            parts.append(own)
            reasons += self._reasons(own, 1)
        return Outcome(joined(parts), reasons)

    def _reasons(self, values: Values, count: int) -> list[str]:
        reasons = [""] * count
        for name, value in values.items():
            if name in self.may_be_infinite or value.dtype.kind not in "fc":
                continue
            whole = np.isfinite(value).reshape(count, -1).all(axis=1)
            for place in np.flatnonzero(~whole):
                reasons[place] = reasons[place] or f"`{name}` is not finite"
        if "converged" in values:
            for place in np.flatnonzero(~values["converged"].astype(bool).reshape(count, -1).all(axis=1)):
                reasons[place] = reasons[place] or "did not converge"
        return reasons


@dataclasses.dataclass(frozen=True)
class PythonTask(AbstractTask):
    """Any function, called case by case: `function(rng, **case)` returns a mapping of names to numbers, booleans, texts
    and arrays.

    A case that raises counts as failed, and the others go on. Numbers are kept as float64, and what a failed case lacks
    is NaN, False, or the empty text.

    **Attributes:**

    - `function`: of a `numpy.random.Generator` and the axes as keywords. For other processes it must stand at the top
        of a module, or cloudpickle must be installed.
    - `units`: name of a result -> its unit.
    - `dims`: name of a result that is an array -> names of its axes.
    """

    function: Callable[..., Mapping[str, Any]]
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    dims: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)

    @property
    def lanes(self) -> int:
        """One case at a time."""
        return 1

    def check(self, axes: tuple[str, ...]) -> None:
        """Raise `InputError` where `function` does not take the `axes`."""
        check_arguments(self.function, "rng", axes)

    def described(self) -> dict[str, Any]:
        """The name of the function."""
        return {"kind": "PythonTask", "function": name_of(self.function)}

    def compute(self, seed: int, block: Block) -> Outcome:
        """Call the function for each case of a `block`; `seed` as in `AbstractTask`."""
        parts: list[Values | None] = []
        reasons: list[str] = []
        for k, stream in enumerate(block.streams):
            rng = np.random.default_rng([seed, int(stream)])
            case = {n: c[k] if c.dtype == object else c[k].item() for n, c in block.columns.items()}
            try:
                parts.append(kept(self.function(rng, **case)))
                reasons.append("")
            except Exception as error:  # a failed case is a result: it is reported with the study
                parts.append(None)
                reasons.append(one_line(error))
        return Outcome(joined(parts), reasons)


def as_task(task: AbstractTask | Callable[..., Mapping[str, Any]]) -> AbstractTask:
    """A `task`, or the `CompiledTask` of a function."""
    if isinstance(task, AbstractTask):
        return task
    if callable(task) and not inspect.isclass(task):
        return CompiledTask(task)
    raise InputError(
        f"{getattr(task, '__name__', type(task).__name__)} is no task",
        place="`task`",
        cure="Give a function that JAX can compile, or a task such as PythonTask(function)",
    )


def kept(result: Any) -> Values:
    """What a function returned for one case, as arrays with a leading axis of one."""
    if not isinstance(result, Mapping):
        raise TypeError(
            f"the function returned a {type(result).__name__} and not a mapping of names to numbers"
        )
    found = {}
    for name, value in result.items():
        array = np.asarray(value)
        if array.dtype.kind in "iuf":
            array = array.astype(float)
        elif array.dtype.kind in "US":
            array = array.astype(object)
        elif array.dtype.kind not in "bc":
            raise TypeError(
                f"`{name}` is a {type(value).__name__} and not a number, a boolean, a text or an array"
            )
        found[str(name)] = array[None]
    return found


def joined(parts: Sequence[Values | None], counts: Sequence[int] | None = None) -> Values:
    """The results of several cases, or of several times so many (`counts`), together; where one of `parts` lacks one,
    NaN, False or the empty text."""
    kinds: dict[str, np.ndarray] = {}
    for part in parts:
        for name, value in (part or {}).items():
            known = kinds.setdefault(name, value)
            if value.shape[1:] != known.shape[1:] or value.dtype != known.dtype:
                raise InputError(
                    f"the result `{name}` is {known.dtype} of shape {known.shape[1:]} in one case and {value.dtype} of "
                    f"shape {value.shape[1:]} in another",
                    place="`task`",
                    cure="Return one kind of array in all cases",
                )
    each = list(zip(parts, counts or [1] * len(parts), strict=True))
    return {
        name: np.concatenate(
            [part[name] if part and name in part else missing(kind, count) for part, count in each]
        )
        for name, kind in kinds.items()
    }


def missing(like: Shaped[np.ndarray, "n ..."], count: int) -> Shaped[np.ndarray, "count ..."]:
    """So many (`count`) results of failed cases, shaped `like` the others: NaN, False, zero or the empty text."""
    fill: Any = {"f": np.nan, "c": np.nan, "O": ""}.get(like.dtype.kind, 0)
    return np.full((count, *like.shape[1:]), fill, like.dtype)


def name_of(function: Callable) -> str:
    """Module and name of a `function`; a case of another study must not be taken for one of it."""
    if isinstance(function, functools.partial):
        given = [
            *map(repr, function.args),
            *(f"{name}={value!r}" for name, value in function.keywords.items()),
        ]
        return f"{name_of(function.func)}({', '.join(given)})"
    name = getattr(function, "__qualname__", type(function).__qualname__)
    return f"{getattr(function, '__module__', '')}.{name}"


def check_arguments(function: Callable, first: str, axes: tuple[str, ...]) -> None:
    """Raise `InputError` where a `function` cannot be called with `first`, a positional argument, and the `axes` as
    keywords."""
    try:
        inspect.signature(function).bind(None, **dict.fromkeys(axes))
    except TypeError as error:
        raise InputError(
            f"the function {name_of(function)} cannot be called with the axes of the design: {error}",
            place="`task`",
            cure=f"Let it take {', '.join((first, *axes))}",
        ) from error


@functools.lru_cache(maxsize=256)
def _program(function: Callable, texts: tuple[tuple[str, str], ...]) -> Callable:
    """The compiled `function` of a task, for one combination of `texts`."""

    def batch(seed: Any, streams: Any, numbers: dict[str, Any]) -> dict[str, Any]:
        def one(stream: Any, numbers: dict[str, Any]) -> dict[str, Any]:
            key = jax.random.fold_in(jax.random.key(seed), stream)
            result = function(key, **dict(texts), **numbers)
            if not isinstance(result, Mapping):
                raise InputError(
                    f"the function {name_of(function)} returned a {type(result).__name__}",
                    place="`task`",
                    cure="Return a mapping of names to numbers and arrays",
                )
            return {str(label): jnp.asarray(value) for label, value in result.items()}

        return jax.vmap(one)(streams, numbers)

    return jax.jit(batch)


def _is_of_the_machine(error: Exception) -> bool:
    """Whether an `error` is that of the machine, such as a lack of memory, and not that of a case."""
    return str(error).startswith(("RESOURCE_EXHAUSTED", "UNAVAILABLE", "DEADLINE_EXCEEDED"))


def one_line(error: Exception) -> str:
    """Why a case failed, by the `error` that it raised, as one line."""
    # Of `equinox.error_if`: its sentence stands among the lines of a traceback.
    if found := re.search(r"EquinoxRuntimeError: ([^\n]+)", str(error)):
        return found[1]
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text[:500]}" if text else type(error).__name__
