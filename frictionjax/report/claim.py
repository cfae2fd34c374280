"""One writer for an output folder: others are refused before they begin, and what a killed one left is put right."""

import hashlib
import os
import shutil
import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.core.files import take_lock
from frictionjax.report.replace import CURE, finish


class Claim(NamedTuple):
    """The right to write into `target`, the output folder with no links in its path, by way of `staging`, a folder."""

    target: Path
    staging: Path


class _Held(threading.local):
    """The claims of a thread, which it may take again: the program holds one while `save_diagnosis` takes it."""

    def __init__(self) -> None:
        self.claims: dict[Path, Claim] = {}


_HELD = _Held()


@contextmanager
def claimed(directory: Path) -> Iterator[Claim]:
    """Keep others from writing into a `directory`, which need not exist, until the context ends.

    What a process that was killed there left beside it is removed; a result that it had ready is put in place, with a
    `FrictionjaxWarning`.

    **Raises:** `InputError` where another process, or another thread, has the claim. On file systems without locks, and
    on Windows, none is refused.
    """
    target = directory.absolute().resolve()
    if target in _HELD.claims:
        yield _HELD.claims[target]
        return
    missing = [folder for folder in target.parents if not folder.exists()]
    staging, lock = _staging(target), None
    try:
        with uninterrupted():
            target.parent.mkdir(parents=True, exist_ok=True)
            lock = _locked(staging, target)
            _put_right(target, staging)
        _HELD.claims[target] = claim = Claim(target, staging)
        yield claim
    finally:
        with uninterrupted():
            _HELD.claims.pop(target, None)
            if lock is not None:
                _remove(staging)
                os.close(lock)
            with suppress(OSError):  # those that hold something by now
                for folder in missing:
                    folder.rmdir()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Interrupts (SIGINT, SIGTERM) come when the context ends: for a few renames."""
    if threading.current_thread() is not threading.main_thread():
        yield  # interrupts reach the main thread only
        return
    came: list[int] = []

    def later(number: int, frame: Any) -> None:
        came.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM)
    # None is a handler that a C library set, which Python could not set again.
    before = {number: found for number in numbers if (found := signal.getsignal(number)) is not None}
    for number in before:
        signal.signal(number, later)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


def _staging(target: Path) -> Path:
    """The folder beside the target where a result is made ready, or inside where nothing can be made beside it or a
    rename from there would not be one; it is known by the target's path."""
    name = f".frictionjax-{hashlib.sha256(os.fsencode(target)).hexdigest()[:12]}"
    beside, inside = target.parent / name, target / name
    if not target.exists() or (os.access(target.parent, os.W_OK | os.X_OK) and not target.is_mount()):
        return beside
    return inside


def _locked(staging: Path, target: Path) -> int:
    """The file descriptor of the lock in the folder `staging`, which is made."""
    while True:
        staging.mkdir(mode=0o700, exist_ok=True)
        found = staging.lstat()
        if hasattr(os, "getuid") and (staging.is_symlink() or found.st_uid != os.getuid()):
            raise InputError("is in the way, and belongs to another user", file=staging, cure=CURE)
        try:
            return take_lock(staging / "lock")
        except FileNotFoundError:  # its last owner has just removed the folder
            continue
        except BlockingIOError:
            raise InputError(
                "another run is writing into this directory",
                file=target,
                cure="Wait until it has ended, or choose another output directory",
            ) from None


def _put_right(target: Path, staging: Path) -> None:
    """Complete, or remove, what a killed process left in the folder `staging`."""
    if finish(target, staging):
        said = f"{target}: the result of a run that was stopped while it was written has been put in place."
        warnings.warn(FrictionjaxWarning(said), stacklevel=5)
    _empty(staging)


def _remove(staging: Path) -> None:
    """Remove the folder, unless a step in it could neither be completed nor taken back: the next run completes it."""
    if (staging / "plan.json").exists():
        return
    _empty(staging)
    with suppress(OSError):  # a folder that cannot be removed is no reason to fail
        (staging / "lock").unlink()
        staging.rmdir()


def _empty(staging: Path) -> None:
    for path in staging.iterdir():
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        elif path.name != "lock":
            path.unlink(missing_ok=True)
