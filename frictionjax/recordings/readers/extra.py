"""Libraries that read one format each: loaded when a file needs them, named where they are absent."""

import contextlib
import importlib
import io
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from frictionjax.core import InputError
from frictionjax.recordings.words import shown

_EXTRAS = {"asammdf": "mdf", "rosbags.highlevel": "ros", "rosbags.typesys": "ros"}
"""Library -> the extra that installs it, where that is not `files`."""


def library(name: str, path: Path) -> ModuleType:
    """The module `name`, which reads the format of a file.

    **Arguments:**

    - `name`: such as `"h5py"`.
    - `path`: the file, for the message.

    **Returns:** the module.

    **Raises:** `InputError` with the command that installs it, where it is absent.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"this format is read by the library {name.partition('.')[0]}, which is not installed ({shown(error)})",
            file=shown(path, 200),
            cure=f'Install it: python -m pip install "frictionjax[{_EXTRAS.get(name, "files")}]"',
        ) from None


def optional(name: str) -> ModuleType | None:
    """The module `name`, or None where it is absent: for what is only faster with it.

    **Arguments:**

    - `name`: such as `"polars"`.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


@contextlib.contextmanager
def clean_errors(path: Path, problem: str, cure: str) -> Iterator[None]:
    """Whatever a damaged file makes of the library that reads it becomes an `InputError`, and what the library prints
    meanwhile is left out. Panics of libraries in Rust, which are no `Exception`, are errors of the file as well.

    **Arguments:**

    - `path`: the file.
    - `problem`: what is wrong then, as a clause; the words of the library are added to it.
    - `cure`: what corrects it.

    **Raises:** `InputError`; `MemoryError` as it is.
    """
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    except (InputError, MemoryError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:
        said = f"{shown(type(error).__name__)}: {shown(error, 80)}"
        _let_go(error)
        raise InputError(f"{problem} ({said})", file=shown(path, 200), cure=cure) from None


def _let_go(error: BaseException | None) -> None:
    """Free what the library held when it raised the `error`: objects that it did not complete may fail once more when
    they end, which would be printed, and files stay open until then."""
    before, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        while error is not None:
            traceback.clear_frames(error.__traceback__)
            error = error.__context__
    finally:
        sys.unraisablehook = before
