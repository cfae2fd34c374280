"""A new result in place of the earlier one: as a whole where the system can exchange two folders, else file by file.

Whatever stops the process, a folder with a verdict.json holds the files of one run. Files of others stay.
"""

import ctypes
import json
import os
import shutil
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from frictionjax.core import InputError
from frictionjax.report.fit_csv import is_fit_csv

VERDICT = "verdict.json"
FILES = (VERDICT, "comparisons.json", "report.html")
"""Files of a result beside fit/*.csv. Without the first there is no result: it goes first and comes last."""
CURE = "Choose another output directory, or make room for this one."
_CASE = "case"  # of the demo, which stands beside its result
_HERE, _EXCHANGE = -100, 2  # AT_FDCWD and RENAME_EXCHANGE of Linux


def put_in_place(fresh: Path, target: Path, staging: Path) -> None:
    """Make the files in the folder `fresh` the result in `target`.

    A failure leaves the earlier result as it was. Where the process is killed, the folder holds the earlier result, the
    new one, or, where folders cannot be exchanged, no verdict.json; `finish` then completes the step.

    **Arguments:**

    - `fresh`: `staging`/new, on the file system of `target`.
    - `target`: the output folder, which need not exist; its parent does.
    - `staging`: a folder for this step alone.
    """
    plan = staging / "plan.json"
    names = _files_in(fresh)
    refuse_foreign(target, [name for name in names if name.parent.name == "fit"])
    steps = {
        "inode": fresh.stat().st_ino,
        "new": [os.fspath(name) for name in names],
        "earlier": [os.fspath(name) for name in _own_files(target)],
    }
    # Complete or not at all: a plan that is cut short would be followed.
    plan.with_suffix(".part").write_text(json.dumps(steps), encoding="ascii")
    plan.with_suffix(".part").rename(plan)
    try:
        _replace(fresh, target, staging, steps)
    except BaseException:
        if (fresh / VERDICT).exists():  # everything was put back
            plan.unlink()
        raise
    plan.unlink()


def finish(target: Path, staging: Path) -> bool:
    """Complete what a killed process left in the folder `staging`: put its result into the folder `target` if it was
    ready.

    **Returns:** whether a result was put in place.
    """
    plan, fresh = staging / "plan.json", staging / "new"
    if not plan.exists():
        return False
    steps = json.loads(plan.read_text(encoding="ascii"))
    ready = fresh.exists() and fresh.stat().st_ino == steps["inode"]
    if ready:
        _remove_foreign_links(fresh, [Path(name) for name in steps["new"]])
        _replace(fresh, target, staging, steps)
    elif fresh.exists():  # the earlier folder: they were exchanged
        _sweep(fresh, target)
    plan.unlink()
    return ready


def _replace(fresh: Path, target: Path, staging: Path, steps: dict) -> None:
    if not target.exists():
        fresh.rename(target)
    elif _exchanged(fresh, target):
        _sweep(fresh, target)
    else:
        _move(fresh, target, staging / "old", steps)


def refuse_foreign(target: Path, names: Iterable[Path]) -> None:
    """Raise `InputError` where one of the `names` in the folder `target` is a file that this package did not write."""
    for name in names:
        if os.path.lexists(target / name) and not is_fit_csv(target / name):
            problem = "exists and was not written by frictionjax, so it is not overwritten"
            raise InputError(problem, file=target / name, cure="Choose another output directory.")


def _own_files(folder: Path) -> list[Path]:
    """The files of an earlier result in a folder, the verdict first."""
    fits = sorted(path for path in (folder / "fit").glob("*.csv") if is_fit_csv(path))
    found = [*(folder / name for name in FILES if (folder / name).exists()), *fits]
    return [path.relative_to(folder) for path in found]


def _files_in(folder: Path) -> list[Path]:
    """Every file in a folder, the verdict last."""
    names = [path.relative_to(folder) for path in sorted(folder.rglob("*")) if path.is_file()]
    return sorted(names, key=lambda name: name == Path(VERDICT))


def _move(fresh: Path, target: Path, old: Path, steps: dict) -> None:
    """File by file: the earlier ones into `old`, the verdict first, then the new ones, the verdict last; what was moved
    already, by a process that was killed, is left. Any failure puts everything back."""
    waiting = {name for name in steps["new"] if (fresh / name).exists()}
    earlier = [name for name in steps["earlier"] if name in waiting or name not in steps["new"]]
    moves = [(target / name, old / name) for name in earlier if (target / name).exists()]
    moves += [(fresh / name, target / name) for name in steps["new"] if name in waiting]
    done: list[tuple[Path, Path]] = []
    try:
        for source, destination in moves:
            destination.parent.mkdir(parents=True, exist_ok=True)
            source.rename(destination)
            done.append((source, destination))
    except BaseException:
        for source, destination in reversed(done):
            destination.rename(source)
        raise


def _exchanged(fresh: Path, target: Path) -> bool:
    """Exchange the two folders in one step, the files of others in `target` being linked into `fresh` before; False,
    with nothing changed, where that is not possible or would surprise."""
    if fresh.is_relative_to(target) or not _is_result_folder(target) or _is_in_use(target):
        return False
    own = set(_own_files(target))
    foreign = [name for name in _files_in(target) if name not in own]
    made: list[Path] = []
    try:
        for name in foreign:
            made += _with_parents(fresh / name)
            os.link(target / name, fresh / name)
            made.append(fresh / name)
        shutil.copystat(target, fresh)
        done = exchange(fresh, target)
    except OSError:  # no links or no such attributes on this file system
        done = False
    if not done:
        _remove_all(made)
    return done


def exchange(one: Path, other: Path) -> bool:
    """Exchange the folders `one` and `other` in one step of the system; False where it knows none."""
    call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None) if sys.platform == "linux" else None
    if call is None:
        return False
    sys.audit("frictionjax.exchange", os.fspath(one), os.fspath(other))
    return call(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0


def _is_result_folder(target: Path) -> bool:
    """Whether a folder holds an earlier result and files, and no folder but those of a result and of the demo."""
    inside = list(_entries(target))
    known = all(path.relative_to(target).parts[0] in ("fit", _CASE) for path in inside if path.is_dir())
    plain = not any(path.is_symlink() or not (path.is_file() or path.is_dir()) for path in inside)
    return known and plain and (target / VERDICT).exists()


def _entries(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        yield path
        if path.is_dir() and not path.is_symlink() and path.name in ("fit", _CASE):
            yield from path.rglob("*")


def _is_in_use(target: Path) -> bool:
    """Whether a folder is the working directory, a mount, or another user's: it stays the folder that it is."""
    own = not hasattr(os, "getuid") or target.stat().st_uid == os.getuid()
    return not own or target.is_mount() or Path.cwd().is_relative_to(target)


def _with_parents(path: Path) -> list[Path]:
    """Make the folders above a path that are missing; returns them, the topmost first."""
    missing = [folder for folder in path.parents if not folder.exists()]
    for folder in reversed(missing):
        folder.mkdir()
    return missing[::-1]


def _remove_all(made: list[Path]) -> None:
    for path in reversed(made):
        if path.is_dir():
            path.rmdir()
        else:
            path.unlink()


def _remove_foreign_links(fresh: Path, names: list[Path]) -> None:
    """Take out of `fresh` what is not of the new result: links to files of others, whose originals are in place."""
    for name in _files_in(fresh):
        if name not in names:
            (fresh / name).unlink()


def _sweep(earlier: Path, target: Path) -> None:
    """Files of others that came into the `earlier` folder while it was exchanged go into `target`."""
    own = set(_own_files(earlier))
    for name in _files_in(earlier):
        if name not in own and not (target / name).exists():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            (earlier / name).rename(target / name)
