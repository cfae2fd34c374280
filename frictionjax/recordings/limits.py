"""Limits on what is read, checked before it is read: a file costs no more than its reader allows."""

import contextlib
import gzip
import io
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.words import shown

GIGABYTES = 0.5
"""What is read of one file, unpacked, unless `reading` allows more; the memory needed is several times that."""
CASE_FILE = 1_000_000  # bytes of a case file: thousands of recordings
LINE = 200_000  # characters of a line of text: ten thousand columns
NESTING = 32  # structures inside structures, of a case file or a MATLAB file

_ALLOWED: ContextVar[float] = ContextVar("gigabytes", default=GIGABYTES)


@contextlib.contextmanager
def reading(gigabytes: float | None) -> Iterator[None]:
    """Allow so many `gigabytes` of each file, unpacked, while the context lasts; None: the usual `GIGABYTES`.

    **Raises:** `InputError` unless they are more than zero.
    """
    if gigabytes is not None and not gigabytes > 0.0:
        raise InputError(f"the limit of {gigabytes:g} GB is not above zero", place="limit")
    token = _ALLOWED.set(GIGABYTES if gigabytes is None else gigabytes)
    try:
        yield
    finally:
        _ALLOWED.reset(token)


def most_bytes() -> int:
    """How many bytes of one file, unpacked, may be read now."""
    return int(_ALLOWED.get() * 1e9)


def too_large(file: str, what: str) -> InputError:
    """The error for a `file` that holds more than may be read; `what` says what is too large."""
    return InputError(
        f"{what} is larger than the limit of {_ALLOWED.get():g} GB",
        file=file,
        cure="Cut the recording, or raise the limit: --limit in GB (limit=... in Python)",
    )


def require_small(path: Path) -> None:
    """Refuse a file that is larger than the limit, as it is or, of a zip archive, unpacked.

    **Arguments:**

    - `path`: an existing file; of an archive the sizes that its directory states are added.

    **Raises:** `InputError`.
    """
    file = shown(path, 200)
    if path.stat().st_size > most_bytes():
        raise too_large(file, f"the file, with {path.stat().st_size / 1e9:.3g} GB,")
    if _unpacked_size(path) > most_bytes():
        raise too_large(file, "its unpacked content")


def _unpacked_size(path: Path) -> int:
    """Bytes of all parts of a zip archive, as its directory states them; 0 where it is none, or one that is damaged or
    of a newer version: the reader says what is wrong with it."""
    try:
        if not zipfile.is_zipfile(path):
            return 0
        with zipfile.ZipFile(path) as archive:
            return sum(part.file_size for part in archive.infolist())
    except Exception:  # whatever a damaged file makes of zipfile
        return 0


def content(path: Path) -> bytes:
    """The bytes of a file, unpacked where it is a gzip file.

    **Arguments:**

    - `path`: an existing file.

    **Raises:** `InputError` for more than the limit, and for a damaged gzip file; `OSError`.
    """
    file = shown(path, 200)
    with path.open("rb") as stream:
        data = bounded(stream.read, file)
    if data[:2] != b"\x1f\x8b":
        return data
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as packed:
            return bounded(packed.read, file)
    except (gzip.BadGzipFile, EOFError, zlib.error):
        raise InputError("the gzip file is damaged or cut short", file=file, cure="Pack it again") from None


def bounded(read: Callable[[int], bytes], file: str) -> bytes:
    """All bytes of a stream that belongs to the `file`: `read` returns so many of them, or what there is.

    **Raises:** `InputError` for more than the limit.
    """
    data = read(most_bytes() + 1)
    if len(data) > most_bytes():
        raise too_large(file, "its content")
    return data


def require_short_lines(data: bytes, file: str) -> None:
    """Refuse a text whose lines are longer than `LINE` bytes, before they are taken apart.

    **Arguments:**

    - `data`: the text, unpacked.
    - `file`: its name, for messages.
    """
    if len(data) <= LINE:
        return
    signs = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero((signs == ord("\n")) | (signs == ord("\r")))
    lengths = np.diff(np.concatenate([[-1], ends, [len(data)]])) - 1
    longest = int(np.argmax(lengths))
    if lengths[longest] > LINE:
        number = data.count(b"\n", 0, int(ends[longest - 1]) + 1 if longest else 0) + 1
        raise InputError(
            f"the line has {lengths[longest]} characters, more than columns of measured channels take ({LINE})",
            file=file,
            place=f"line {number}",
            cure="Write one line for each sample, with the columns that are needed",
        )
