"""Recordings cut into pieces of a few fixed shapes, so that one compiled program serves recordings of any number and
length.

A piece has four rows, the last of them repeated where there are fewer recordings, and as many samples as the next of a
few lengths; loops along it end where its longest recording does (`simulation/samples.py`), so that pieces of
neighbouring lengths take the longer one, and one program, at little cost. What is computed of the pieces is cut to size
and put together by NumPy.
"""

import weakref
from collections.abc import Callable, Hashable, Sequence
from typing import Literal, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from frictionjax.core.arrays import Numbers

_T = TypeVar("_T")

# Rows: with their derivatives they fill the vector units. A second width would save two recordings a third of their
# simulations, and compile every structure twice. A filter, whose candidates go side by side, fills them with two.
_WIDTH, _PAIR = 4, 2
SHORTEST, _TIMES = 16384, 4  # samples: lengths are the first times powers of the second
_EARLIER = (
    128  # earlier pieces of motion, sixteen of each of eight recordings: as lengths, in powers of the same
)


class Piece(NamedTuple):
    """Some recordings: their `rows`, the same with the last repeated up to the width of the piece, `lanes`, the number
    of `samples` of the longest, and the `length` to which all are padded."""

    rows: Int[np.ndarray, " k"]
    lanes: Int[np.ndarray, " w"]
    samples: int
    length: int


class RunLength(NamedTuple):
    """What is a number of the case in a piece, and of the program otherwise: the `samples` to be run along, and the
    integration `substeps` a sample."""

    samples: Int[Numbers, ""]
    substeps: Int[Numbers, ""]


def pieces_of(lengths: Int[np.ndarray, " r"], *, pairs: bool = False) -> tuple[Piece, ...]:
    """The pieces of recordings that have so many samples, those of about one length together; `pairs`: of two rows."""
    order, pieces, length = np.argsort(-lengths, kind="stable"), [], 0
    while order.size:
        width = _PAIR if pairs else _WIDTH
        rows, order = order[:width], order[width:]
        lanes = np.concatenate([rows, np.repeat(rows[-1:], width - rows.size)])
        samples = int(lengths[rows[0]])
        own = _room(samples, SHORTEST)
        # A filter keeps so much of each sample that room for more would cost it more than a program.
        if pairs or own * _TIMES != length:
            length = own
        pieces.append(Piece(rows, lanes, samples, length))
    return tuple(pieces)


def _room(count: int, least: int) -> int:
    """The next of the lengths that holds `count`, the shortest being `least`."""
    length = least
    while length < count:
        length *= _TIMES
    return length


def lengths_up_to(samples: int) -> list[int]:
    """The lengths that pieces of recordings of up to so many `samples` may have, in order."""
    lengths = [SHORTEST]
    while lengths[-1] < samples:
        lengths.append(_TIMES * lengths[-1])
    return lengths


def lanes_of(tree: PyTree, piece: Piece) -> PyTree:
    """The lanes of the `piece` of every array, shape `(r, ...)`, of a `tree`."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[piece.lanes], tree)


def earlier_of(values: Float[Numbers, "r k"], piece: Piece) -> Float[np.ndarray, "w m"]:
    """The lanes of the `piece` of what was before each recording; zeros follow."""
    own = np.asarray(values)[piece.lanes]
    return np.pad(own, ((0, 0), (0, _room(own.shape[1], _EARLIER) - own.shape[1])))


def padded(
    values: Float[Numbers, "r n ..."],
    piece: Piece,
    beyond: Literal["last", "zero", "line"] = "last",
) -> Float[Array, "w m ..."]:
    """The lanes of the `piece` of a signal, padded to its length with the last value, with zeros, or along the line
    through the last two. It is kept as long as the `values` are: a descent asks for it at each step."""

    def make() -> Float[Array, "w m ..."]:
        own = np.asarray(values)[piece.lanes, : piece.length]
        more = piece.length - own.shape[1]
        if beyond == "zero" or not more:
            return jax.device_put(np.pad(own, ((0, 0), (0, more), *((0, 0),) * (own.ndim - 2))))
        tail = np.repeat(own[:, -1:], more, axis=1)
        if beyond == "line":
            tail = tail + (own[:, -1:] - own[:, -2:-1]) * np.arange(1, more + 1)
        return jax.device_put(np.concatenate([own, tail], axis=1))

    return kept(values, (tuple(piece.lanes), piece.length, beyond), make)


def padded_lanes(values: Float[np.ndarray, "k r n"], piece: Piece) -> Float[np.ndarray, "k w m"]:
    """The lanes of the `piece` of several signals of each recording, padded to its length with zeros."""
    own = np.asarray(values)[:, piece.lanes, : piece.length]
    return np.pad(own, ((0, 0), (0, 0), (0, piece.length - own.shape[2])))


_KEPT: dict[int, tuple[weakref.ref, dict]] = {}


def kept(source: object, key: Hashable, make: Callable[[], _T]) -> _T:
    """What `make` makes of the array or Module `source`, made once for each `key` while the `source` lives."""
    number = id(source)
    known = _KEPT.get(number)
    if known is None or known[0]() is not source:
        known = _KEPT[number] = (weakref.ref(source, lambda _: _KEPT.pop(number, None)), {})
    if key not in known[1]:
        known[1][key] = make()
    return known[1][key]


def put_in_order(parts: Sequence[tuple[Piece, Numbers]], rows: int) -> Float[np.ndarray, " rows"]:
    """A number of each row of all pieces, shape `(w,)` each, in the order of the recordings."""
    whole = np.empty(rows)
    for piece, part in parts:
        whole[piece.rows] = np.asarray(part)[: piece.rows.size]
    return whole


def put_together(
    parts: Sequence[tuple[Piece, Numbers]], rows: int, samples: int, axis: int = 0
) -> Float[np.ndarray, "..."]:
    """The rows of all pieces, cut to `samples`: arrays with the lanes at `axis` and the samples behind it."""
    shape = list(parts[0][1].shape)
    shape[axis], shape[axis + 1] = rows, samples
    whole, front = np.empty(shape), (slice(None),) * axis
    for piece, part in parts:
        most = min(samples, piece.length)
        whole[(*front, piece.rows, slice(0, most))] = np.asarray(part)[
            (*front, slice(0, piece.rows.size), slice(0, most))
        ]
        whole[(*front, piece.rows, slice(most, samples))] = 0.0
    return whole
