"""The problems as NIST publishes them: two starts, certified values to eleven digits, and data, in one text file each.

The files do not come with the repository; `SOURCE` says where to get them.
"""

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.nist.models import LOGARITHM, MODELS
from frictionjax.core import InputError
from frictionjax.studies.real_machines import VARIABLE

SOURCE = (
    "The source archive of lmfit has all 27 in its folder NIST_STRD: run `pip download lmfit==1.3.4 --no-binary lmfit "
    "--no-deps`, unpack it"
)
"""Where to get the files."""

_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?)"
_PARAMETER = re.compile(rf"\s*b(\d+)\s*=\s*{_NUMBER}\s+{_NUMBER}\s+{_NUMBER}\s+{_NUMBER}\s*")
_SQUARES = re.compile(rf"Residual Sum of Squares:\s*{_NUMBER}")
_LINES = re.compile(r"Data\s+\(lines\s+(\d+)\s+to\s+(\d+)\)")
_LEVEL = re.compile(r"(\w+) Level of Difficulty")


class Problem(NamedTuple):
    """One problem.

    `name`, `level` of difficulty by NIST; `x`: predictors, shape `(k, n)`; `y`: response, or its logarithm, that the
    model stands for, shape `(n,)`; `starts`, shape `(2, p)`; `certified` values and their `deviations`, shape `(p,)`;
    `squares`: the certified residual sum of squares.
    """

    name: str
    level: str
    x: Float[np.ndarray, "k n"]
    y: Float[np.ndarray, " n"]
    starts: Float[np.ndarray, "2 p"]
    certified: Float[np.ndarray, " p"]
    deviations: Float[np.ndarray, " p"]
    squares: float


def read_problem(path: Path) -> Problem:
    """The problem in the file at `path`, named as the file is.

    **Raises:** `InputError` for a file that is not laid out as those of NIST.
    """
    text = path.read_text(encoding="ascii", errors="replace")
    lines = text.splitlines()
    found = [match for line in lines if (match := _PARAMETER.fullmatch(line))]
    squares, place, level = (pattern.search(text) for pattern in (_SQUARES, _LINES, _LEVEL))
    if not (found and squares and place and level):
        raise InputError(
            "this is no problem of nonlinear regression as NIST lays it out: lines for the parameters, the residual "
            "sum of squares, the level of difficulty or the lines of the data are missing",
            place=str(path),
            cure=f"{SOURCE}.",
        )
    if [int(match[1]) for match in found] != list(range(1, len(found) + 1)):
        raise InputError("the parameters are not b1, b2, ... in turn", place=str(path), cure=f"{SOURCE}.")
    numbers = np.array([[float(value) for value in match.groups()[1:]] for match in found])
    first, last = int(place[1]), int(place[2])
    rows = []
    for number in range(first, last + 1):
        values = lines[number - 1].split() if number <= len(lines) else []
        try:
            rows.append([float(value) for value in values])
        except ValueError:
            rows.append([])
        if len(rows[-1]) < 2 or len(rows[-1]) != len(rows[0]):
            raise InputError(
                f"a response and its predictors are expected, not `{' '.join(values)}`",
                place=f"{path}, line {number}",
                cure=f"{SOURCE}.",
            )
    data = np.array(rows).T
    y = np.log(data[0]) if path.stem in LOGARITHM else data[0]
    starts, certified, deviations = numbers[:, :2].T, numbers[:, 2], numbers[:, 3]
    return Problem(path.stem, level[1], data[1:], y, starts, certified, deviations, float(squares[1]))


def all_problems(folders: Sequence[Path] | None = None, names: Iterable[str] = MODELS) -> list[Problem]:
    """The problems of these `names`, all 27 by default.

    **Arguments:**

    - `folders`: where to search, subfolders included; absent: those that the environment variable `FRICTIONJAX_DATA`
      names.
    - `names`: of the problems.

    **Raises:** `InputError` where a file is missing; it says where to get it.
    """
    if folders is None:
        folders = [Path(folder) for folder in os.environ.get(VARIABLE, "").split(os.pathsep) if folder]
    found = []
    for name in names:
        path = next((path for folder in folders for path in sorted(folder.rglob(f"{name}.dat"))), None)
        if path is None:
            raise InputError(
                f"{name}.dat of NIST's nonlinear regression problems is not on this disk",
                cure=f"{SOURCE}, and name that folder by `--data` or in {VARIABLE}.",
            )
        found.append(read_problem(path))
    return found
