"""`compiled`: functions of arrays and Modules as compiled programs, which later processes load instead of making them.

JAX keeps what XLA compiles on disk, but each process traces and lowers every function again to find it there: for the
loops of this library that takes longer than to run them. What `compiled` keeps is the finished program, under a key
that needs no tracing: the function, the structure of its arguments, their shapes, and the source of this package.
Programs lie where JAX keeps its own (`keep_compiled`); without such a folder each process makes its own.
"""

import functools
import hashlib
import os
import pickle
import threading
import uuid
import warnings
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, NamedTuple, ParamSpec, TypeVar

import jax
import numpy as np
from jax.core import Tracer
from jax.experimental import serialize_executable
from jaxtyping import PyTree

from frictionjax.core.errors import FrictionjaxWarning
from frictionjax.core.setup import processor, programs_folder

_P = ParamSpec("_P")
_R = TypeVar("_R")
_ARRAYS = jax.Array | np.ndarray
# Programs that a process keeps, up to 15 MB each; those that were not used for longest are let go, and found on the
# disk when they are wanted again. More hold memory; fewer than the hundred of a diagnosis are read again within it.
_MOST = 150
# Structures of a simulated drive, of some 10 MB each.
_MOST_STRUCTURES = 32
_PACKAGE = Path(__file__).parents[1]
_BASE = ("core", "physics", "recordings", "excitation", "simulation", "frequency", "estimation")
# Whose classes may stand in a kept program: the source of other classes may change without a trace in the key.
_KNOWN = ("frictionjax.", "builtins", "jaxlib.", "jax.", "numpy")


class _Program(NamedTuple):
    """A compiled program, and a result with numbers in place of its arrays."""

    run: jax.stages.Compiled
    result: PyTree


class CompiledFunction(Generic[_P, _R]):
    """A function whose arrays, of NumPy or JAX, are the arguments of compiled programs, one for each structure of the
    other arguments and each set of shapes. It returns arrays, or Modules and tuples of them. Inside transformations it
    is the function itself."""

    def __init__(self, function: Callable[_P, _R], options: dict[str, Any] | None) -> None:
        functools.update_wrapper(self, function)
        self._function = function
        self._options = options

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        leaves, structure = jax.tree.flatten((args, kwargs))
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            return self._function(*args, **kwargs)
        dynamic = [leaf for leaf in leaves if isinstance(leaf, _ARRAYS)]
        shapes = tuple((leaf.shape, leaf.dtype) if isinstance(leaf, _ARRAYS) else leaf for leaf in leaves)
        signature = (self._function, structure, shapes)
        program = _MEMORY.get(signature, lambda: self._made(args, kwargs, shapes, structure))
        found = program.run(*dynamic)
        return jax.tree.map(lambda place: found[place], program.result)

    def _made(self, args: tuple, kwargs: dict, shapes: tuple, structure: Any) -> _Program:
        """The program of these arguments, from the disk or made anew."""
        folder = programs_folder()
        name = None if folder is None else self._name(args, kwargs, shapes, structure)
        if folder is None or name is None:  # JAX itself may find it again
            return self._new(args, kwargs, self._function.__name__)
        path = folder / name
        if (kept := _read(path)) is not None:
            return kept
        # What JAX's own cache returns cannot be kept again: its copy lacks some of the machine code. A name that was
        # never used before is not found there.
        once = f"{self._function.__name__}_{uuid.uuid4().hex}"
        program = self._new(args, kwargs, once)
        _remove_copies(folder.parent, once)
        return _written(path, program)

    def _new(self, args: tuple, kwargs: dict, name: str) -> _Program:
        leaves, structure = jax.tree.flatten((args, kwargs))
        places = [place for place, leaf in enumerate(leaves) if isinstance(leaf, _ARRAYS)]
        # The arrays themselves are not kept by the closure of the program.
        rest = [None if place in places else leaf for place, leaf in enumerate(leaves)]
        results: list[PyTree] = []

        def flat(*arrays: Any) -> list[Any]:
            own = list(rest)
            for place, array in zip(places, arrays, strict=True):
                own[place] = array
            given, named = jax.tree.unflatten(structure, own)
            whole = self._function(*given, **named)  # type: ignore[call-arg]
            found, shape = jax.tree.flatten(whole)
            results.append(jax.tree.unflatten(shape, range(len(found))))
            return found

        flat.__name__ = name
        dynamic = [jax.ShapeDtypeStruct(leaves[place].shape, leaves[place].dtype) for place in places]
        return _Program(jax.jit(flat).lower(*dynamic).compile(self._options), results[-1])

    def _name(self, args: tuple, kwargs: dict, shapes: tuple, structure: Any) -> str | None:
        """Name of the program on the disk; None where it cannot be known by its text alone."""
        names = (self._function.__module__, *(kind.__module__ for kind in _kinds((args, kwargs))))
        if not names[0].startswith("frictionjax.") or not all(name.startswith(_KNOWN) for name in names):
            return None
        text = repr(
            (self._function.__module__, self._function.__qualname__, structure, shapes, self._options)
        )
        if " at 0x" in text or "<function" in text:
            return None
        return hashlib.sha256((_surroundings(self._function.__module__) + text).encode()).hexdigest()


class _With(NamedTuple):
    """A decorator that makes a `CompiledFunction` of a function, with these `options`."""

    options: dict[str, Any] | None

    def __call__(self, function: Callable[_P, _R]) -> CompiledFunction[_P, _R]:
        return CompiledFunction(function, self.options)


def compiled(*, options: dict[str, Any] | None = None) -> _With:
    """A decorator that makes a `CompiledFunction` of a function, with these `options` of XLA."""
    return _With(options)


class _Traced:
    """A function under `jax.jit` for one structure of its arguments; `result` has numbers in place of the arrays."""

    def __init__(self, function: Callable, args: tuple, kwargs: dict) -> None:
        leaves, structure = jax.tree.flatten((args, kwargs))
        places = [place for place, leaf in enumerate(leaves) if isinstance(leaf, _ARRAYS)]
        rest = [None if place in places else leaf for place, leaf in enumerate(leaves)]
        self.result: PyTree = None

        def flat(*arrays: Any) -> list[Any]:
            own = list(rest)
            for place, array in zip(places, arrays, strict=True):
                own[place] = array
            given, named = jax.tree.unflatten(structure, own)
            found, shape = jax.tree.flatten(function(*given, **named))
            self.result = jax.tree.unflatten(shape, range(len(found)))
            return found

        flat.__name__ = function.__name__
        self.run = jax.jit(flat)


class Jitted(Generic[_P, _R]):
    """A function under `jax.jit`, also inside of transformations. Of the structures of its arguments, such as the
    effects of a drive, those that were not used for longest are let go, and their programs with them: JAX itself keeps
    the programs of a function as long as the function. It returns arrays, or Modules and tuples of them."""

    def __init__(self, function: Callable[_P, _R]) -> None:
        functools.update_wrapper(self, function)
        self._function = function

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        leaves, structure = jax.tree.flatten((args, kwargs))
        shapes = tuple((leaf.shape, leaf.dtype) if isinstance(leaf, _ARRAYS) else leaf for leaf in leaves)
        signature = (self._function, structure, shapes)
        traced = _STRUCTURES.get(signature, lambda: _Traced(self._function, args, kwargs))
        found = traced.run(*(leaf for leaf in leaves if isinstance(leaf, _ARRAYS)))
        return jax.tree.map(lambda place: found[place], traced.result)


def _kinds(tree: PyTree) -> set[type]:
    """The types of all parts of a `tree`."""
    found: set[type] = set()

    def seen(part: Any) -> bool:
        found.add(type(part))
        return False

    jax.tree.flatten(tree, is_leaf=seen)
    return found


class _Memory(Generic[_R]):
    """The programs of this process by signature, each made by one thread while others wait for it; no more of them than
    `most` says now."""

    def __init__(self, most: Callable[[], int]) -> None:
        self._programs: OrderedDict[Hashable, _R] = OrderedDict()
        self._most = most
        self._making: dict[Hashable, threading.Lock] = {}
        self._lock = threading.Lock()

    def get(self, signature: Hashable, make: Callable[[], _R]) -> _R:
        """The program of the `signature`, which `make` makes where there is none."""
        with self._lock:
            if signature in self._programs:
                self._programs.move_to_end(signature)
                return self._programs[signature]
            own = self._making.setdefault(signature, threading.Lock())
        with own:
            with self._lock:
                if signature in self._programs:
                    return self._programs[signature]
            program = make()
            with self._lock:
                self._programs[signature] = program
                self._making.pop(signature, None)
                while len(self._programs) > self._most():
                    self._programs.popitem(last=False)
        return program

    def __len__(self) -> int:
        return len(self._programs)

    def clear(self) -> None:
        """Let all programs go."""
        with self._lock:
            self._programs.clear()


_MEMORY: _Memory[_Program] = _Memory(lambda: _MOST)
_STRUCTURES: _Memory[_Traced] = _Memory(lambda: _MOST_STRUCTURES)


def forget_programs() -> None:
    """Let the programs of this process go; those on the disk stay."""
    _MEMORY.clear()
    _STRUCTURES.clear()


def programs_held() -> int:
    """How many programs this process holds."""
    return len(_MEMORY) + len(_STRUCTURES)


@functools.cache
def _source(unit: str) -> str:
    """A digest of the source of the units that functions of all units are built on, and of this `unit`."""
    digest = hashlib.sha256()
    for name in sorted({*_BASE, unit}):
        for path in sorted((_PACKAGE / name).rglob("*.py")):
            digest.update(str(path.relative_to(_PACKAGE)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def _surroundings(module: str) -> str:
    """All that a program of a function in the `module` depends on besides the function and its arguments."""
    parts = (
        _source(module.split(".")[1]),
        *(version(name) for name in ("jax", "jaxlib", "equinox")),
        processor(),
        os.environ.get("XLA_FLAGS", ""),
        jax.default_backend(),
        len(jax.devices()),
    )
    return repr(parts)


def _read(path: Path) -> _Program | None:
    """The program in the file `path`; None where there is none, or a damaged one, which is replaced later."""
    try:
        with path.open("rb") as stream:
            if hasattr(os, "getuid") and os.fstat(stream.fileno()).st_uid != os.getuid():
                return None  # another user's, which came while the folder was open to others: it is not run
            content = stream.read()
    except FileNotFoundError:
        return None
    digest, packed = content[:32], content[32:]
    if hashlib.sha256(packed).digest() != digest:
        warnings.warn(
            f"A kept program was damaged, and is compiled again: {path}", FrictionjaxWarning, stacklevel=2
        )
        return None
    binary, count, result = pickle.loads(zlib.decompress(packed))
    arguments = jax.tree.structure(((0,) * count[0], {}))
    results = jax.tree.structure([0] * count[1])
    run = serialize_executable.deserialize_and_load(
        binary, arguments, results, execution_devices=jax.devices()[:1]
    )
    return _Program(run, result)


def _remove_copies(folder: Path, name: str) -> None:
    """Remove what JAX has just kept of a program with this `name` in its `folder`: nothing asks for it again."""
    for copy in folder.glob(f"jit_{name}-*"):
        copy.unlink(missing_ok=True)


def _written(path: Path, program: _Program) -> _Program:
    """The `program`, kept in the file `path` from now on."""
    binary, arguments, results = serialize_executable.serialize(program.run)
    count = (arguments.num_leaves, results.num_leaves)
    packed = zlib.compress(pickle.dumps((binary, count, program.result)), 1)
    whole = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        # Complete or not at all: other processes read while this one writes.
        whole.write_bytes(hashlib.sha256(packed).digest() + packed)
        whole.replace(path)
    except OSError as error:
        whole.unlink(missing_ok=True)
        warnings.warn(
            f"A compiled program cannot be kept, and is compiled again next time ({error.strerror}): {path.parent}",
            FrictionjaxWarning,
            stacklevel=2,
        )
    return program
