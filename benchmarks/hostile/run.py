"""Damaged inputs read in child processes, with a limit on the time and the memory of each."""

import multiprocessing
import os
import resource
import shutil
import signal
import time
import warnings
from collections import Counter
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from benchmarks.hostile.seeds import damaged, seeds, seeds_of_extras
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files, load_case
from frictionjax.recordings.readers import open_table

KINDS = ("clean errors", "accepted", "faults", "hangs", "deaths")
_AT_ONCE = 1000  # inputs of one child process
_LONGEST_MESSAGE = 1500


def run(
    inputs: int,
    seed: int,
    scratch: Path,
    *,
    seconds: float = 20.0,
    gigabytes: float = 2.0,
    keep: Path | None = None,
    extras: bool = False,
) -> dict[str, Counter[str]]:
    """Read so many damaged `inputs`, the first with this `seed`, and count what came of them, for each reader.

    **Arguments:**

    - `inputs`, `seed`: as above; an input is known by its reader and its number.
    - `scratch`: an empty folder.
    - `seconds`, `gigabytes`: of one input, before it counts as a hang or a fault; memory beyond that of the process.
    - `keep`: folder for the inputs that were neither read nor refused in one line.
    - `extras`: read the formats of the extras, and not the others.
    """
    readers = list(seeds_of_extras() if extras else seeds())
    table = {reader: Counter[str]() for reader in readers}
    for place, reader in enumerate(readers):
        share = inputs // len(readers) + (place < inputs % len(readers))
        first = seed
        while first < seed + share:
            last = min(first + _AT_ONCE, seed + share)
            first = _batch(reader, first, last, scratch, seconds, gigabytes, table[reader], keep, extras)
    return table


def _batch(
    reader: str,
    first: int,
    last: int,
    scratch: Path,
    seconds: float,
    gigabytes: float,
    counts: Counter[str],
    keep: Path | None,
    extras: bool,
) -> int:
    """Read inputs `first` to `last` in one child process, until one of them ends it; returns the next number."""
    # This process has not computed: its imports are shared. But threads of the libraries of the extras, with which it
    # has made their files, would not be there in a fork.
    context = multiprocessing.get_context("spawn" if extras else "fork")
    now, results = context.Value("q", first), context.SimpleQueue()
    child = context.Process(target=_child, args=(reader, first, last, scratch, gigabytes, now, results))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX, with which the child computes nothing
        child.start()
    hung = not _ended(child, now, seconds)
    if hung and child.pid is not None:
        os.kill(child.pid, signal.SIGKILL)
    child.join()
    while not results.empty():
        number, kind = results.get()
        counts[kind] += 1
        if kind not in KINDS[:2]:
            _keep(keep, reader, number, kind)
    if child.exitcode == 0:
        return last
    stopped = now.value
    kind = "hangs" if hung else "deaths"
    counts[kind] += 1
    _keep(keep, reader, stopped, kind)
    return stopped + 1


def _ended(child: multiprocessing.Process, now: "Synchronized[int]", seconds: float) -> bool:
    """Whether the child ends by itself, no input taking longer than so many seconds."""
    number, since = now.value, time.monotonic()
    while child.is_alive():
        child.join(0.2)
        if now.value != number:
            number, since = now.value, time.monotonic()
        elif time.monotonic() - since > seconds:
            return False
    return True


def _child(
    reader: str,
    first: int,
    last: int,
    scratch: Path,
    gigabytes: float,
    now: "Synchronized[int]",
    results: object,
) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    most = used + int(gigabytes * 1e9)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    warnings.simplefilter("ignore", FrictionjaxWarning)
    for number in range(first, last):
        now.value = number
        results.put((number, outcome(reader, number, scratch)))  # type: ignore[attr-defined]


def outcome(reader: str, number: int, scratch: Path) -> str:
    """What comes of reading the damaged input of a `reader` with this `number`, in the folder `scratch`."""
    path = written(reader, number, scratch)
    try:
        return read(path)
    finally:
        path.unlink()


def read(path: Path) -> str:
    """Read a file as far as a diagnosis does before it computes: "accepted", "clean errors" or "faults"."""
    try:
        if path.suffix == ".toml":
            load_case(path)
        else:
            table = open_table(path)
            table.read([name for name in table.names if table.has(name)])
            case_from_files(path, sample_rate=None if table.has("t") else 1000.0)
    except InputError as error:
        message = str(error)
        return "clean errors" if "\n" not in message and len(message) < _LONGEST_MESSAGE else "faults"
    except Exception:
        return "faults"
    return "accepted"


def written(reader: str, number: int, folder: Path) -> Path:
    """The damaged input of a `reader` with this `number`, as a file in the `folder`, with what it needs beside it."""
    files = seeds_of(reader)
    name, data = files[number % len(files)]
    path = folder / name
    path.write_bytes(damaged(data, number))
    if reader == "case":
        rows = seeds_of("text")[0][1]
        (folder / "run.csv").write_bytes(rows)
        header, body = rows.split(b"\n", 1)
        (folder / "kept.csv").write_bytes(header + b"\n" + body.replace(b"\n", b"1\n"))
    return path


_SEEDS: dict[str, list[tuple[str, bytes]]] = {}


def seeds_of(reader: str) -> list[tuple[str, bytes]]:
    """The small valid files of a `reader`, made once."""
    if not _SEEDS:
        _SEEDS.update(seeds())
    if reader not in _SEEDS:
        _SEEDS.update(seeds_of_extras())
    return _SEEDS[reader]


def _keep(keep: Path | None, reader: str, number: int, kind: str) -> None:
    if keep is not None:
        folder = keep / f"{kind} {reader} {number}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        written(reader, number, folder)
