"""HDF5: `.h5`, `.hdf5`, and MATLAB files of version 7.3, which are HDF5."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.readers.extra import clean_errors, library

_UNIT_ATTRIBUTES = ("units", "unit", "Units", "Unit")


def open_hdf5(path: Path) -> ArrayTable:
    """Open an HDF5 file.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table: data sets under their paths (`run/x`), columns of a matrix as `data[:,0]`, fields of a
    compound one as `table.x`; an attribute `units` is the unit.

    **Raises:** `InputError` where h5py is absent, for a damaged file, and one without a vector of numbers.
    """
    return _open(path, Collected("data set"), lambda name: name, "Write it again")


def open_mat73(path: Path) -> ArrayTable:
    """Open a MATLAB file of version 7.3.

    **Arguments:**

    - `path`: an existing file.

    **Returns:** its table, under the names of MATLAB: `run.u`, `data(:,1)`.

    **Raises:** as `open_hdf5`.
    """
    found = Collected("variable", lambda name, column: f"{name}(:,{column + 1})")
    return _open(
        path,
        found,
        lambda name: name.replace("/", "."),
        "In MATLAB, save it again with save('name.mat', '-v7')",
    )


def _open(path: Path, found: Collected, named: Callable[[str], str], cure: str) -> ArrayTable:
    h5py = library("h5py", path)

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):  # what MATLAB keeps for itself
            return
        _collect(path, name, named(name), item, found)

    with clean_errors(path, "is not an HDF5 file that can be read", cure), h5py.File(path, "r") as file:
        file.visititems(visit)
    return found.table(path)


def _collect(path: Path, name: str, as_named: str, item: Any, found: Collected) -> None:
    """Add one data set."""
    matlab = _text(item.attrs.get("MATLAB_class"))
    if item.dtype.names is not None:
        for field in item.dtype.names:
            kind = item.dtype[field]
            found.add_later(f"{as_named}.{field}", item.shape, kind, _reading(path, name, field))
    elif matlab == "char":
        found.refused[as_named] = "holds text, not numbers"
    elif matlab == "cell" or item.dtype.kind == "O":
        found.refused[as_named] = "is a cell array, text or a reference, not a vector of numbers"
    elif item.shape is None or "MATLAB_empty" in item.attrs:
        found.refused[as_named] = "is empty"
    else:
        found.add_later(as_named, item.shape, item.dtype, _reading(path, name))
        unit = next((_text(item.attrs[key]) for key in _UNIT_ATTRIBUTES if key in item.attrs), "")
        if unit:
            found.units[as_named] = unit


def _reading(path: Path, name: str, field: str | None = None) -> Callable[[int | None], np.ndarray]:
    """A function that reads a data set, or the numbered column of one, along its longer side."""

    def read(column: int | None) -> np.ndarray:
        h5py = library("h5py", path)
        with h5py.File(path, "r") as file:
            item = file[name]
            if field is not None:
                return item[field].ravel()
            if column is None:
                return item[()].ravel()
            return item[column] if item.shape[0] < item.shape[1] else item[:, column]

    return read


def _text(value: Any) -> str:
    """An attribute as text."""
    return (
        value.decode("utf-8", "replace")
        if isinstance(value, bytes)
        else value
        if isinstance(value, str)
        else ""
    )
