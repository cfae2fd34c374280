"""Checks a MATLAB file before SciPy reads it: a wrong tag or a deep structure would end the process without a word.

The file is walked as the format's description has it (MAT-File Format, levels 4 and 5): every type, size and depth,
nothing being read but those.
"""

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from frictionjax.recordings.limits import NESTING, most_bytes

_MATRIX, _COMPRESSED = 14, 15
_INT8, _INT32, _UINT32 = 1, 5, 6
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_TEXT = _NUMBERS | {16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_LARGEST_NUMERIC = 15
_COMPLEX = 1 << 11
_DIMENSIONS = 32
_PARTS = 200_000  # arrays in one file, those in cells and fields counted
# Of level 4: bytes of a number by the code of its type.
_LEVEL_4 = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}


class Damaged(Exception):
    """The file is not as its format says."""


class TooLarge(Exception):
    """The file holds more, unpacked, than may be read."""


class _Element(NamedTuple):
    """One element: its type, and its bytes from `start` to `end`; the next one is at `after`."""

    kind: int
    start: int
    end: int
    after: int


class _Walk:
    """A walk through `data`, whose numbers are in the byte `order`; `parts` counts the arrays."""

    def __init__(self, data: bytes, order: str, parts: list[int]) -> None:
        self.data, self.order, self.parts = data, order, parts

    def tag(self, at: int, end: int) -> _Element:
        """The element at `at`, which may not reach beyond `end`."""
        if at + 8 > end:
            raise Damaged("it ends inside a tag")
        first, size = struct.unpack_from(f"{self.order}II", self.data, at)
        if first >> 16:  # type and size in one word, the data in the other
            kind, size, start, after = first & 0xFFFF, first >> 16, at + 4, at + 8
            if size > 4:
                raise Damaged(f"a short element of {size} bytes")
            return _Element(kind, start, start + size, after)
        start = at + 8
        if start + size > end:
            raise Damaged("an element that is longer than what it is in")
        return _Element(first, start, start + size, min(start + size + -size % 8, end))

    def of(self, at: int, end: int, kinds: frozenset[int] | set[int]) -> _Element:
        """The element at `at`, of one of the `kinds`."""
        found = self.tag(at, end)
        if found.kind not in kinds:
            raise Damaged(f"an element of type {found.kind} where that of {sorted(kinds)[0]} is expected")
        return found

    def numbers(self, element: _Element) -> tuple[int, ...]:
        count = (element.end - element.start) // 4
        return struct.unpack_from(f"{self.order}{count}i", self.data, element.start)

    def matrix(self, at: int, end: int, depth: int = 0) -> tuple[_Element, str]:
        """The array at `at` and all that it holds; returned with its name."""
        if depth > NESTING:
            raise Damaged(f"structures nested more than {NESTING} deep")
        self.parts[0] += 1
        if self.parts[0] > _PARTS:
            raise Damaged(f"more than {_PARTS} arrays")
        own = self.of(at, end, {_MATRIX})
        if own.start == own.end:
            return own, ""
        flags = self.of(own.start, own.end, {_UINT32})
        if flags.end - flags.start != 8:
            raise Damaged("array flags of a wrong size")
        bits = self.numbers(flags)[0]
        kind, at = bits & 0xFF, flags.after
        if kind == _OPAQUE:
            for _ in range(3):
                at = self.of(at, own.end, {_INT8}).after
            self.matrix(at, own.end, depth + 1)
            return own, ""
        dimensions = self.of(at, own.end, {_INT32})
        shape = self.numbers(dimensions)
        if not 2 <= len(shape) <= _DIMENSIONS or min(shape) < 0:
            raise Damaged("dimensions that no array has")
        size = 1
        for length in shape:
            size *= length
        name = self.of(dimensions.after, own.end, {_INT8})
        self._body(kind, bool(bits & _COMPLEX), size, name.after, own.end, depth)
        return own, self.data[name.start : name.end].decode("latin-1")

    def _body(self, kind: int, is_complex: bool, size: int, at: int, end: int, depth: int) -> None:
        """What follows flags, dimensions and name of an array of `size` values."""
        if kind == _CHAR or (_CHAR < kind <= _LARGEST_NUMERIC and kind != _SPARSE):
            for _ in range(2 if is_complex else 1):
                part = self.of(at, end, _TEXT if kind == _CHAR else _NUMBERS)
                if kind != _CHAR and size and not (part.end - part.start) % size == 0:
                    raise Damaged("an array whose size is not that of its dimensions")
                if kind != _CHAR and size > part.end - part.start:
                    raise Damaged("an array with fewer values than its dimensions say")
                at = part.after
        elif kind == _SPARSE:
            for _ in range(4 if is_complex else 3):
                at = self.of(at, end, _NUMBERS).after
        elif kind == _CELL:
            self._matrices(size, at, end, depth)
        elif kind in (_STRUCT, _OBJECT):
            if kind == _OBJECT:
                at = self.of(at, end, {_INT8}).after
            length = self.of(at, end, {_INT32})
            names = self.of(length.after, end, {_INT8})
            room = (self.numbers(length) or (0,))[0]
            if room <= 0 or (names.end - names.start) % room:
                raise Damaged("field names of a wrong length")
            self._matrices(size * ((names.end - names.start) // room), names.after, end, depth)
        elif kind == _FUNCTION:
            self._matrices(1, at, end, depth)
        else:
            raise Damaged(f"an array of class {kind}")

    def _matrices(self, count: int, at: int, end: int, depth: int) -> None:
        for _ in range(count):
            at = self.matrix(at, end, depth + 1)[0].after


def variables(data: bytes) -> list[str]:
    """The names of the variables in a MATLAB file of level 4 or 5 that SciPy can read without harm.

    **Arguments:**

    - `data`: the whole file.

    **Raises:** `Damaged`, and `TooLarge` for one whose content exceeds the limit when it is unpacked.
    """
    # As SciPy decides it: the first four bytes of level 5 are text.
    return list(_level_4(data) if 0 in data[:4] or len(data) < 128 else _level_5(data))


def _level_5(data: bytes) -> Iterator[str]:
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise Damaged("a header without the mark of the format")
    parts, unpacked, at = [0], 0, 128
    while at < len(data):
        element = _Walk(data, order, parts).tag(at, len(data))
        if element.kind == _COMPRESSED:
            walk = _Walk(_inflated(data[element.start : element.end], most_bytes() - unpacked), order, parts)
            unpacked += len(walk.data)
            _, name = walk.matrix(0, len(walk.data))
            at = element.end  # no bytes fill it up
        else:
            found, name = _Walk(data, order, parts).matrix(at, len(data))
            at = found.after
        if name:
            yield name


def _inflated(packed: bytes, most: int) -> bytes:
    inflater = zlib.decompressobj()
    try:
        data = inflater.decompress(packed, most + 1)
    except zlib.error as error:
        raise Damaged(str(error)) from None
    if len(data) > most:
        raise TooLarge
    if not inflater.eof:
        raise Damaged("compressed data that is cut short")
    return data


def _level_4(data: bytes) -> Iterator[str]:
    at = 0
    while at < len(data):
        if at + 20 > len(data):
            raise Damaged("it ends inside a header")
        order = "<" if 0 <= struct.unpack_from("<i", data, at)[0] <= 5000 else ">"
        code, rows, columns, imaginary, length = struct.unpack_from(f"{order}5i", data, at)
        machine, reserved, number, kind = (code // 10**k % 10 for k in (3, 2, 1, 0))
        if not 0 <= code <= 5000 or machine > 1 or reserved or number not in _LEVEL_4 or kind > 2:
            raise Damaged("a header that is not of the format")
        if min(rows, columns) < 0 or imaginary not in (0, 1) or not 0 < length <= len(data):
            raise Damaged("sizes that no matrix has")
        start = at + 20 + length
        at = start + rows * columns * _LEVEL_4[number] * (1 + imaginary)
        if at > len(data):
            raise Damaged("a matrix that is longer than the file")
        name = data[start - length : start].split(b"\0")[0].decode("latin-1")
        if kind != 2:  # a sparse matrix is no vector of samples
            yield name
