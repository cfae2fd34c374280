"""Cases that are spoiled in one place, and the check of the message that follows."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from frictionjax.core import InputError
from frictionjax.recordings import case_from_files, load_case

N = 200
RATE = 1000.0
HEADER = 'name = "bad"\n'
FIT = '[[recording]]\nfile = "run.csv"\n'
HOLDOUT = '[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'


def columns():
    """Time (s), input and position of a small motion, each of shape `(N,)`."""
    t = np.arange(N) / RATE
    return t, np.cos(40.0 * t), np.round(0.01 * np.sin(40.0 * t), 9)


def lines():
    return ["t,u,x", *(f"{t:.3f},{u:.9g},{x:.9g}" for t, u, x in zip(*columns(), strict=True))]


def write(folder: Path, name="run.csv", change=None, rows=None):
    rows = lines() if rows is None else rows
    if change:
        rows = change(rows) or rows
    (folder / name).write_text("\n".join(rows) + "\n")


def toml(folder: Path, text=HEADER + FIT + HOLDOUT, change=None, **files):
    """A case of two recordings; `change` spoils the rows of run.csv."""
    write(folder, change=change)
    write(folder, "kept.csv", rows=[lines()[0], *(row + "1" for row in lines()[1:])])
    (folder / "case.toml").write_text(text)
    return lambda: load_case(folder / "case.toml")


def spoiled(k: int, old: str | None = None, new: str = ""):
    """Rows with one field changed: the row of line `k`, `old` counted as the last field when None."""

    def change(rows):
        row = rows[k - 1]
        rows[k - 1] = row.rsplit(",", 1)[0] + "," + new if old is None else row.replace(old, new, 1)

    return lambda folder: toml(folder, change=change)


def plant(text: str):
    return lambda folder: toml(folder, HEADER + f"[plant]\n{text}\n" + FIT + HOLDOUT)


def recording(text: str, change=None):
    return lambda folder: toml(folder, HEADER + FIT + text + "\n" + HOLDOUT, change=change)


def case(text: str):
    return lambda folder: toml(folder, text)


def rows(change):
    return lambda folder: toml(folder, change=change)


def raw(name: str, data: bytes):
    """A case whose first recording is a file of these bytes."""

    def make(folder):
        call = toml(folder, HEADER + FIT.replace("run.csv", name) + HOLDOUT)
        (folder / name).write_bytes(data)
        return call

    return make


def mat(text: str = "", **content):
    """A case whose first recording is a MATLAB file."""

    def make(folder):
        call = toml(folder, HEADER + FIT.replace("run.csv", "run.mat") + text + "\n" + HOLDOUT)
        t, u, x = columns()
        savemat(folder / "run.mat", {"t": t, "u": u, "x": x} | content)
        return call

    return make


def bare(*args, **options):
    """`case_from_files` on files that are there."""

    def make(folder):
        toml(folder)
        names = [[folder / name for name in names] for names in args]
        return lambda: case_from_files(*names, **options)

    return make


def cell():
    array = np.empty((1, 2), dtype=object)
    array[0, 0], array[0, 1] = np.arange(3.0), "text"
    return array


def dropped_t(rows):
    return [row.split(",", 1)[1] for row in rows]


def check_message(call, words):
    """`call` raises an `InputError` whose one line holds all `words`."""
    with pytest.raises(InputError) as error:
        call()
    message = str(error.value)
    assert len(message.splitlines()) == 1, message
    assert len(message) < 900, message
    assert message.endswith((".", "?")), message
    for word in words:
        assert word in message, f"{word!r} is not in: {message}"
