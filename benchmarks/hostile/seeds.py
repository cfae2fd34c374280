"""Small valid files, one or more for each reader, and the ways in which they are damaged."""

import gzip
import io
import random
import struct
from collections.abc import Callable

import numpy as np
from scipy.io import savemat

from benchmarks.hostile.more_seeds import extra_seeds, plain_seeds

ROWS = 330  # enough to hold out a third
RATE = 1000.0


def _columns() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(ROWS) / RATE
    return t, np.cos(40.0 * t), np.round(0.01 * np.sin(40.0 * t), 9)


def _rows(separator: str = ",", header: str = "t,u,x", comma: bool = False) -> bytes:
    body = [separator.join(f"{value:.9g}" for value in row) for row in zip(*_columns(), strict=True)]
    text = "\n".join([*([header] if header else []), *body]) + "\n"
    return (text.replace(".", ",") if comma else text).encode()


def _mat(content: dict, **options: object) -> bytes:
    stream = io.BytesIO()
    savemat(stream, content, **options)
    return stream.getvalue()


def _struct() -> dict:
    t, u, x = _columns()
    cell = np.empty((2, 1), dtype=object)
    cell[:] = [[np.arange(3.0)], ["text"]]
    return {
        "run": {"t": t, "u": u, "x": x},
        "c": cell,
        "name": "rig",
        "z": np.array([1j, 2.0]),
        "x": x,
        "u": u,
    }


_CASE = b"""name = "fuzzed"

[plant]
motor_constant = 16.0
position_unit = "rad"
encoder_step = 9.6e-6

[[recording]]
file = "run.csv"
role = "fit"
columns = {t = "t", u = "u", x = "x"}
scale = {x = 1e-3}
interval = [0.0, 0.1]

[[recording]]
file = "kept.csv"
role = "holdout"
start_time = 0.0
"""


def seeds() -> dict[str, list[tuple[str, bytes]]]:
    """Reader -> its small valid files, as (name of the file, content)."""
    t, u, x = _columns()
    plain = {"t": t, "u": u, "x": x}
    texts = [
        ("a.csv", _rows()),
        ("b.txt", _rows("\t", header="")),
        ("c.csv", _rows(";", "t;u;x", comma=True)),
        ("d.txt", b"# t u x\n" + _rows(" ", header="")),
        ("e.csv", "t,u,x\n".encode("utf-16") + _rows(header="").decode().encode("utf-16-le")),
        ("f.csv", b"log of a rig\nt,u,x\ns,A,rad\n" + _rows(header="")),
    ]
    return {
        "text": texts,
        "gzip": [("a.csv.gz", gzip.compress(_rows(), mtime=0))],
        "mat 5": [("a.mat", _mat(plain)), ("b.mat", _mat(_struct()))],
        "mat 5, compressed": [("c.mat", _mat(_struct(), do_compression=True))],
        "mat 4": [("d.mat", _mat(plain, format="4"))],
        "case": [("case.toml", _CASE)],
        **plain_seeds(plain),
    }


def seeds_of_extras() -> dict[str, list[tuple[str, bytes]]]:
    """As `seeds`, for the readers of the extras that are installed."""
    return extra_seeds(dict(zip("tux", _columns(), strict=True)))


_TOKENS = (
    b"nan",
    b"inf",
    b"1e999",
    b"-",
    b"1e-310",
    b"",
    b"\0",
    b'"',
    b",,",
    b"9" * 400,
    b"\xff\xfe",
    b"[",
    b"=",
    b"\n",
)
_WORDS = (0, 1, 2, 7, 8, 14, 15, 255, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x00010001)


def _flip(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _byte(data: bytearray, rng: random.Random) -> None:
    data[rng.randrange(len(data))] = rng.randrange(256)


def _word(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(max(len(data) - 4, 1)) & ~3
    data[at : at + 4] = struct.pack("<I", rng.choice(_WORDS))


def _token(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    data[at : at + rng.randrange(12)] = rng.choice(_TOKENS)


def _cut(data: bytearray, rng: random.Random) -> None:
    del data[rng.randrange(len(data)) :]


def _remove(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    del data[at : at + rng.randrange(1, 64)]


def _repeat(data: bytearray, rng: random.Random) -> None:
    at = rng.randrange(len(data))
    data[at:at] = data[at : at + rng.randrange(1, 200)] * rng.randrange(1, 40)


_DAMAGES: tuple[Callable[[bytearray, random.Random], None], ...] = (
    *(_flip, _byte, _word, _token, _cut, _remove, _repeat),
)


def damaged(data: bytes, seed: int) -> bytes:
    """A copy of `data` with one to eight damages, the same ones for each `seed`."""
    rng = random.Random(seed)
    copy = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        if copy:
            rng.choice(_DAMAGES)(copy, rng)
    return bytes(copy)
