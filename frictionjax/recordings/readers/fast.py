"""The fast way through a large text file of plain numbers: all cores, for files that need no care."""

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.readers.extra import optional

_LEAST = 1 << 20
"""Bytes below which NumPy is done before the library would be loaded."""


def numbers_of(
    data: bytes,
    columns: Sequence[int],
    width: int,
    separator: str,
    start: int,
    *,
    decimal_comma: bool = False,
    least: int = _LEAST,
) -> list[Float[np.ndarray, " n"]] | None:
    """Columns of a plain text file by polars, if it is installed.

    **Arguments:**

    - `data`: the content, in ASCII or UTF-8.
    - `columns`: which columns, from 0.
    - `width`: number of columns.
    - `separator`: one character.
    - `start`: lines before the numbers.
    - `decimal_comma`: whether numbers have decimal commas.
    - `least`: bytes from which on it is worth while.

    **Returns:** one array a column, shape `(n,)`, NaN where a field is empty; None for a file that the careful reader
    has to look at: comments, quotes, lines of another width, or anything that is not a number.
    """
    if len(data) < least or any(sign in data for sign in (b"#", b"%", b'"')):
        return None
    if data.count(b"\r") != data.count(b"\r\n"):  # line ends of a carriage return alone
        return None
    polars = optional("polars")
    if polars is None:
        return None
    place = 0
    for _ in range(start):
        place = data.index(b"\n", place) + 1
    body = data[place:].removeprefix(b"\xef\xbb\xbf")
    try:
        frame = polars.read_csv(
            io.BytesIO(body),
            has_header=False,
            separator=separator,
            quote_char=None,
            columns=sorted(set(columns)),
            schema={str(k): polars.Float64 for k in range(width)},
            decimal_comma=decimal_comma,
        )
    except polars.exceptions.PolarsError:
        return None
    # Where each line has as many separators as it must, none is too short or too long.
    if frame.height * (width - 1) != body.count(separator.encode()):
        return None
    return [
        np.ascontiguousarray(frame[str(k)].fill_null(float("nan")).to_numpy(), dtype=np.float64)
        for k in columns
    ]
