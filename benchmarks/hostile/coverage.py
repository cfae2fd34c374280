"""Inputs that atheris changes by which lines they reach: `python -m benchmarks.hostile --atheris READER`."""

import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType

from benchmarks.hostile.run import read, seeds_of, written


class NeitherReadNorRefused(Exception):
    """An input that ended neither in a recording nor in one line; atheris writes it into a file."""


def fuzz(reader: str, inputs: int, seed: int) -> int:
    """Read so many `inputs` of a `reader`, the first ones its valid files; stops at the first that is neither read nor
    refused in one line.

    **Returns:** 2 where atheris is absent; else atheris ends the process itself, with 0 after all inputs.
    """
    try:
        import atheris
    except ImportError:
        sys.stderr.write("atheris is not installed: python -m pip install atheris\n")
        return 2
    for function in _functions_of_readers():
        atheris.instrument_func(function)  # in place
    folder = Path(tempfile.mkdtemp())
    (folder / "valid").mkdir()
    for number, (name, data) in enumerate(seeds_of(reader)):
        (folder / "valid" / f"{number} {name}").write_bytes(data)
    path = written(reader, 0, folder)
    warnings.simplefilter("ignore")

    def one(data: bytes) -> None:
        path.write_bytes(data)
        if read(path) == "faults":
            raise NeitherReadNorRefused(reader)

    atheris.Setup([sys.argv[0], f"-runs={inputs}", f"-seed={seed + 1}", str(folder / "valid")], one)
    atheris.Fuzz()
    return 0


def _functions_of_readers() -> Iterator[FunctionType]:
    """The functions and methods of this package that read; of the libraries, which are many, none."""
    modules = [module for name, module in sys.modules.items() if name.startswith("frictionjax.recordings")]
    parts = [part for module in modules for part in vars(module).values() if _is_ours(part)]
    for part in dict.fromkeys(parts):
        for function in vars(part).values() if isinstance(part, type) else (part,):
            if isinstance(function, FunctionType):
                yield function


def _is_ours(part: object) -> bool:
    """Whether it is a function or a class of the package's readers."""
    own = str(getattr(part, "__module__", "")).startswith("frictionjax.recordings")
    return own and isinstance(part, FunctionType | type)
