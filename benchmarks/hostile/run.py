"""Damaged inputs read in child processes, with a limit on the time and the memory of each."""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from benchmarks.hostile.seeds import damaged, seeds, seeds_of_extras
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings import case_from_files, load_case
from frictionjax.recordings.readers import open_table

KINDS = ("clean errors", "accepted", "faults", "hangs", "deaths")
_AT_ONCE = 1000  # inputs of one child process
_AT_ONCE_SPAWNED = 4000  # of one that begins with its imports
_LONGEST_MESSAGE = 1500
_NOT_YET = -1  # in place of the number of an input, while a child makes ready
_IDLE = 10  # times as long as the processor may work on an input, the input may take
_TO_BEGIN = 10  # times as long as one input may take


def run(
    inputs: int,
    seed: int,
    scratch: Path,
    *,
    seconds: float = 20.0,
    gigabytes: float = 2.0,
    keep: Path | None = None,
    extras: bool = False,
    rows: Path | None = None,
) -> dict[str, Counter[str]]:
    """Read so many damaged `inputs`, the first with this `seed`, and count what came of them, for each reader.

    **Arguments:**

    - `inputs`, `seed`: as above; an input is known by its reader and its number.
    - `scratch`: an empty folder.
    - `seconds`, `gigabytes`: of the processor, and of memory beyond that of the process, for one input; ten times as
      many seconds by the clock. More counts as a hang or a fault.
    - `keep`: folder for the inputs that were neither read nor refused in one line.
    - `extras`: read the formats of the extras, and not the others.
    - `rows`: a file of JSON lines to which the counts of each part are appended; parts that are in it already are not
      read again, so that a run that was stopped goes on where it was.
    """
    readers = list(seeds_of_extras() if extras else seeds())
    table = {reader: Counter[str]() for reader in readers}
    done = {} if rows is None else finished(rows)
    for reader, first, last in _parts(readers, inputs, seed, _AT_ONCE_SPAWNED if extras else _AT_ONCE):
        counts = done.get((reader, first, last))
        if counts is None:
            counts = Counter[str]()
            number = first
            while number < last:
                number = _batch(reader, number, last, scratch, seconds, gigabytes, counts, keep, extras)
            if rows is not None:
                row = {"reader": reader, "first": first, "last": last} | {
                    kind: counts[kind] for kind in KINDS
                }
                with rows.open("a", encoding="ascii") as file:
                    file.write(json.dumps(row) + "\n")
        table[reader] += counts
    return table


def finished(rows: Path) -> dict[tuple[str, int, int], Counter[str]]:
    """Reader, first and last number of each part in the file `rows` -> its counts; none where there is no file."""
    lines = rows.read_text(encoding="ascii").splitlines() if rows.exists() else []
    parts = [json.loads(line) for line in lines]
    return {
        (part["reader"], part["first"], part["last"]): Counter({kind: part[kind] for kind in KINDS})
        for part in parts
    }


def _parts(readers: list[str], inputs: int, seed: int, size: int) -> Iterator[tuple[str, int, int]]:
    """Reader, first and last number of parts of at most this `size`, the readers by turns."""
    shares = [inputs // len(readers) + (place < inputs % len(readers)) for place in range(len(readers))]
    for start in range(0, max(shares), size):
        for reader, share in zip(readers, shares, strict=True):
            if start < share:
                yield reader, seed + start, seed + min(start + size, share)


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
    now, results = context.Value("q", _NOT_YET), context.SimpleQueue()
    child = context.Process(target=_child, args=(reader, first, last, scratch, gigabytes, now, results))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX, with which the child computes nothing
        child.start()

    def count() -> None:
        while not results.empty():
            number, kind = results.get()
            counts[kind] += 1
            if kind not in KINDS[:2]:
                _keep(keep, reader, number, kind)

    hung = not _ended(child, now, seconds, count)
    if hung and child.pid is not None:
        os.kill(child.pid, signal.SIGKILL)
    child.join()
    count()
    if child.exitcode == 0:
        return last
    stopped = now.value
    if stopped == _NOT_YET:
        raise RuntimeError(f"The child process that was to read damaged files of {reader} did not begin.")
    kind = "hangs" if hung else "deaths"
    counts[kind] += 1
    _keep(keep, reader, stopped, kind)
    return stopped + 1


def _ended(
    child: multiprocessing.Process, now: "Synchronized[int]", seconds: float, meanwhile: Callable[[], None]
) -> bool:
    """Whether the child ends by itself, no input taking more than so many `seconds` of the processor; `meanwhile` takes
    what it says."""
    number, since, used = now.value, time.monotonic(), 0.0
    while child.is_alive():
        child.join(0.1)
        meanwhile()
        if now.value != number:
            number, since, used = now.value, time.monotonic(), _used(child.pid)
        allowed = seconds * (_TO_BEGIN if number == _NOT_YET else 1)
        # On a busy machine an input waits its turn; one that waits for something else uses no time.
        if _used(child.pid) - used > allowed or time.monotonic() - since > _IDLE * allowed:
            return False
    return True


def _used(pid: int | None) -> float:
    """Processor time that a child process has used, s; 0 once it has ended."""
    try:
        fields = (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        )
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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
    _silence()
    for name, data in seeds_of(reader):  # libraries are loaded before time is counted
        (scratch / name).write_bytes(data)
        read(scratch / name)
    warnings.simplefilter("ignore", FrictionjaxWarning)
    for number in range(first, last):
        now.value = number
        results.put((number, outcome(reader, number, scratch)))  # type: ignore[attr-defined]


def _silence() -> None:
    """What libraries print about damaged files goes nowhere."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


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
    except KeyboardInterrupt:
        raise
    except BaseException:  # a panic in Rust is no `Exception`
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
