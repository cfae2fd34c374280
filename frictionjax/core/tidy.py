"""The folder of compiled programs: what was cut short is removed, and what was not used for longest beyond a size."""

import contextlib
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

try:
    import zstandard  # type: ignore[import-not-found]
except ImportError:
    zstandard = None

LARGEST = 2_000_000_000  # bytes of all kept programs: some twenty versions or processors
_PART_KEPT = 0.8  # of `LARGEST` that is left when it was exceeded, so that it is not exceeded again at once
_JAX = "-cache"  # the end of the names of JAX's entries
_ZSTANDARD = b"\x28\xb5\x2f\xfd"
_MARK = "tidied"


def tidy(folder: Path, *, largest: int = LARGEST) -> None:
    """Remove entries of JAX that were cut short, which it would never replace, and the least used ones beyond a size.

    Only entries that came after the last call are read, and nothing is done where none came.

    **Arguments:**

    - `folder`: all kept programs, of every processor and version.
    - `largest`: bytes that may be kept.
    """
    mark = folder / _MARK
    before = mark.stat().st_mtime_ns if mark.exists() else 0
    places = [folder, *(place for place in folder.rglob("*") if place.is_dir())]
    if all(place.stat().st_mtime_ns < before for place in places[1:]):
        return
    sizes = []
    for file, found in _files(places):
        with contextlib.suppress(OSError):  # another process has removed it
            is_new = found.st_mtime_ns >= before and file.name.endswith(_JAX)
            if is_new and not _is_whole(file):
                file.unlink()
            else:
                if is_new:  # this look was no use
                    os.utime(file, ns=(found.st_atime_ns, found.st_mtime_ns))
                sizes.append((max(found.st_atime_ns, found.st_mtime_ns), found.st_size, file))
    excess = sum(size for _, size, _ in sizes) - largest
    if excess > 0:
        excess += (1.0 - _PART_KEPT) * largest
        for _, size, file in sorted(sizes):
            if excess <= 0:
                break
            with contextlib.suppress(OSError):
                file.unlink()
            excess -= size
    with contextlib.suppress(OSError):  # a full disk: the next call looks again
        mark.touch()


def _files(places: list[Path]) -> Iterator[tuple[Path, os.stat_result]]:
    for place in places:
        with os.scandir(place) as entries:
            for entry in entries:
                if entry.name != _MARK and entry.is_file(follow_symlinks=False):
                    yield Path(entry.path), entry.stat()


def _is_whole(file: Path) -> bool:
    """Whether an entry of JAX can be unpacked to its end."""
    data = file.read_bytes()
    if data.startswith(_ZSTANDARD):
        if zstandard is None:
            return True  # JAX does not read it either
        try:
            zstandard.ZstdDecompressor().decompress(data)
        except zstandard.ZstdError:
            return False
        return True
    unpacker = zlib.decompressobj()
    try:
        unpacker.decompress(data)
    except zlib.error:
        return False
    return unpacker.eof
