"""Files that are there as a whole or not at all, and locks that end with the process that holds them."""

import errno
import os
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
PART = ".part"
"""How the name of a file ends that is being written."""


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Make the file `path`, of what `write` writes into a stream: complete and on the disk, or not there.

    A process that is killed meanwhile leaves a hidden file that ends in `.part`.

    **Raises:** `OSError` where it cannot be written; an earlier file then stays.
    """
    fresh = path.with_name(f".{path.name}.{uuid.uuid4().hex}{PART}")
    try:
        with fresh.open("xb") as stream:
            write(stream)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(path)
    except BaseException:
        fresh.unlink(missing_ok=True)
        raise
    to_disk(path.parent)


def to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, at `path` survive a loss of power, where the system can say."""
    try:
        place = os.open(path, os.O_RDONLY)
    except PermissionError:  # Windows opens no folders
        return
    try:
        os.fsync(place)
    except OSError as error:
        if error.errno not in (errno.EINVAL, *_NO_LOCKS):  # some network file systems know no such call
            raise
    finally:
        os.close(place)


def take_lock(path: Path) -> int:
    """Take the lock of the file `path`, which is made. It lasts until the returned file descriptor is closed, or the
    process ends, however it ends.

    On file systems without locks, and on Windows, everybody is given it.

    **Raises:** `BlockingIOError` where another process, or another thread, has it; `FileNotFoundError` where the folder
        has been removed.
    """
    while True:
        lock = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
        try:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(lock)
                raise
        with suppress(FileNotFoundError):  # its last owner has just removed it
            if os.path.samestat(os.fstat(lock), path.stat()):
                return lock
        os.close(lock)
