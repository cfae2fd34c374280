"""What a file holds, by its first bytes: for files whose suffix says nothing, or another format than their content."""

import gzip
import struct
import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

from frictionjax.recordings.words import shown

_HEAD = 4096
"""Bytes that are looked at."""


class ContentKind(NamedTuple):
    """What a file holds.

    **Attributes:**

    - `what`: in words, "an HDF5 file".
    - `suffix`: the suffix of the reader that reads it as it is; empty where none does.
    - `cure`: what makes it readable where none does, with a command to copy.
    """

    what: str
    suffix: str
    cure: str


_READ = {
    b"\x89HDF\r\n\x1a\n": ("an HDF5 file", ".h5"),
    b"MATLAB 5.0 MAT-file": ("a MATLAB file", ".mat"),
    b"MATLAB 7.3 MAT-file": ("a MATLAB file", ".mat"),
    b"PAR1": ("a Parquet file", ".parquet"),
    b"ARROW1": ("an Arrow file", ".arrow"),
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": ("an Excel file of an older version", ".xls"),
    b"TDSm": ("a TDMS file of LabVIEW", ".tdms"),
    b"MDF     ": ("an MDF file", ".mf4"),
    b"UnFinMF ": ("an MDF file", ".mf4"),
}
"""First bytes -> what the file holds, and the suffix of its reader, which needs no suffix itself."""
_BAGS = {b"#ROSBAG V": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""First bytes of bags of ROS, whose library goes by the suffix -> that suffix."""
_PACKED = {
    b"\x28\xb5\x2f\xfd": ("a file packed by zstd", "zstd -d"),
    b"BZh": ("a file packed by bzip2", "bunzip2"),
    b"\xfd7zXZ\0": ("a file packed by xz", "unxz"),
    b"7z\xbc\xaf\x27\x1c": ("an archive of 7-Zip", "7z x"),
    b"Rar!\x1a\x07": ("an archive of RAR", "unrar x"),
}
"""First bytes -> what the file holds, and the command that unpacks it."""
_OTHERS = {
    b"\x93NUMPY": (
        "a single NumPy array",
        'Save all columns together: numpy.savez("run.npz", t=t, u=u, x=x)',
    ),
    **{
        bytes([0x80, version]): (
            "a pickle, which may run any program when it is loaded and is never read",
            'Where you trust it, write a table of it: pandas.read_pickle(...).to_csv("run.csv")',
        )
        for version in range(2, 6)
    },
    b"%PDF-": ("a PDF document", "Export the table in it as CSV"),
    b"\x89PNG": ("a picture", "Give the numbers behind it, as CSV"),
    b"\xff\xd8\xff": ("a picture", "Give the numbers behind it, as CSV"),
}
"""First bytes of what holds no table that is read -> what it is, and what to do."""
_TAR = "a tar archive"


def kind_of(path: Path) -> ContentKind | None:
    """What a file holds, if its first bytes say so; None for text, and for what is not known or cannot be opened.

    **Arguments:**

    - `path`: an existing file.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except OSError:  # its reader says why
        return None
    file = shown(path.name, 80)
    if head.startswith(b"\x1f\x8b"):
        inside = _kind(_unpacked(path), path, file)
        if inside is None or inside.suffix == ".json":
            return inside
        command = "tar -xf" if inside.what == _TAR else "gunzip"
        return ContentKind(f"a gzip file with {inside.what} in it", "", f"Unpack it: {command} {file}")
    return _kind(head, path, file)


def _kind(head: bytes, path: Path, file: str) -> ContentKind | None:
    for sign, (what, suffix) in _READ.items():
        # In text there is no null character, whatever it begins with.
        if head.startswith(sign) and b"\0" in head:
            return ContentKind(what, suffix, "")
    if head[512:].startswith(b"\x89HDF\r\n\x1a\n"):  # after a block of the user
        return ContentKind("an HDF5 file", ".h5", "")
    for sign, suffix in _BAGS.items():
        if head.startswith(sign) and b"\0" in head:
            if file.lower().endswith(suffix):
                return ContentKind("a bag of ROS", suffix, "")
            return ContentKind("a bag of ROS", "", f"Give it the suffix of its format: {file}{suffix}")
    for sign, (what, command) in _PACKED.items():
        if head.startswith(sign) and not head.isascii():
            return ContentKind(what, "", f"Unpack it: {command} {file}")
    for sign, (what, cure) in _OTHERS.items():
        if head.startswith(sign):
            return ContentKind(what, "", cure)
    if head[257:262] == b"ustar":
        return ContentKind(_TAR, "", f"Unpack it: tar -xf {file}")
    if head.startswith(b"PK\x03\x04"):
        return _archive(path)
    if head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"[{", b"[[")):
        return ContentKind("JSON", ".json", "")
    return None


_DAMAGED = (zipfile.BadZipFile, struct.error, OSError, ValueError, OverflowError, NotImplementedError)
"""What zipfile raises for an archive whose list of names it cannot read."""


def _archive(path: Path) -> ContentKind | None:
    """What a zip archive is, by the names in it; None for one of other files, and a damaged one."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except _DAMAGED:  # its reader says what is wrong with it
        return None
    if names and all(name.endswith(".npy") for name in names):
        return ContentKind("a NumPy archive", ".npz", "")
    if any(name.startswith("xl/") for name in names):
        return ContentKind("an Excel file", ".xlsx", "")
    if "content.xml" in names:
        return ContentKind("a spreadsheet of OpenDocument", ".ods", "")
    return None


def _unpacked(path: Path) -> bytes:
    """The first bytes of what a gzip file holds; none of a damaged one: its reader says so."""
    try:
        with gzip.open(path) as packed:
            return packed.read(_HEAD)
    except (gzip.BadGzipFile, EOFError, zlib.error):
        return b""
