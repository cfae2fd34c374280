"""MATLAB files up to v7: vectors, matrices and structs of numbers."""

import functools
import io
import warnings
from pathlib import Path

import numpy as np
import scipy

from frictionjax.core import InputError
from frictionjax.recordings.limits import content, too_large
from frictionjax.recordings.readers.arrays import ArrayTable
from frictionjax.recordings.readers.hdf5 import open_mat73
from frictionjax.recordings.readers.mat_check import Damaged, TooLarge, variables
from frictionjax.recordings.words import shown

_HDF5 = b"\x89HDF\r\n\x1a\n"
# The columns of a matrix are channels; a wider matrix is an image, not a set of channels.
_WIDEST_MATRIX = 64


def open_mat(path: Path) -> ArrayTable:
    """Open a MATLAB file of version 4 to 7.3.

    **Arguments:**

    - `path`: an existing `.mat` file.

    **Returns:** its table. A field of a struct is `run.u`, of the second element of a struct array `run(2).u`, a matrix
    column `data(:,1)`.

    **Raises:** `InputError` for a damaged file, one without a numeric vector, and a v7.3 (HDF5) file where h5py is
    absent.
    """
    file = shown(path, 200)
    try:
        with path.open("rb") as stream:
            head = stream.read(1024)
            if head.startswith((b"MATLAB 7.3", _HDF5)) or _HDF5 in head:
                return open_mat73(path)
        data = content(path)
        sound = variables(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # duplicate variables, which may well be unused ones
            found = scipy.io.loadmat(io.BytesIO(data), variable_names=sound) if sound else {}
    except InputError:
        raise
    except TooLarge:
        raise too_large(file, "its unpacked content") from None
    except Damaged as error:
        raise InputError(
            f"is not a MATLAB file that can be read: it is damaged ({error})",
            file=file,
            cure="In MATLAB, save it again with save('name.mat', '-v7')",
        ) from None
    except OSError as error:
        raise InputError(
            f"cannot be opened ({shown(error.strerror)})", file=file, cure="Check its rights"
        ) from None
    except Exception as error:  # whatever a damaged file makes of scipy's parser
        raise InputError(
            f"is not a MATLAB file that can be read ({shown(type(error).__name__)}: {shown(error)})",
            file=file,
            cure="In MATLAB, save it again with save('name.mat', '-v7')",
        ) from None
    columns: dict[str, np.ndarray] = {}
    refused: dict[str, str] = {}
    for name, value in found.items():
        if not name.startswith("__"):
            _collect(name, value, columns, refused)
    if not columns:
        raise InputError(
            "the file contains no numeric vector", file=file, cure="Save each channel as a numeric vector"
        )
    readers = {name: functools.partial(np.asarray, values) for name, values in columns.items()}
    return ArrayTable(path, tuple(columns), readers, refused, "variable", {}, {})


def _collect(name: str, value: object, columns: dict[str, np.ndarray], refused: dict[str, str]) -> None:
    """Add one variable, and what it contains, to the vectors of numbers or to the refused, with the reason."""
    if not isinstance(value, np.ndarray):
        refused[name] = "is not an array of numbers (a sparse matrix or a MATLAB object)"
    elif value.dtype.names is not None and type(value) is np.ndarray:
        for number, element in enumerate(value.ravel(), start=1):
            prefix = name if value.size == 1 else f"{name}({number})"
            for field in value.dtype.names:
                _collect(f"{prefix}.{field}", element[field], columns, refused)
    elif value.dtype == object or value.dtype.names is not None:
        refused[name] = (
            "is a cell array or a MATLAB object (table, timeseries), not a numeric vector: save its numbers as one, "
            "such as `x = cell2mat(x)` or `x = ts.Data`"
        )
    elif value.dtype.kind not in "buif":
        refused[name] = "holds text or complex numbers, not real numbers"
    elif value.size < 2:
        refused[name] = f"has {value.size} value{'s' * (value.size != 1)}, not a vector of samples"
    elif value.ndim <= 2 and min(value.shape) == 1:
        columns[name] = value.ravel().astype(np.float64)
    elif value.ndim == 2 and min(value.shape) <= _WIDEST_MATRIX:
        by_rows = value.shape[0] < value.shape[1]
        vectors = value if by_rows else value.T
        entries = [f"{name}({k},:)" if by_rows else f"{name}(:,{k})" for k in range(1, len(vectors) + 1)]
        columns.update(zip(entries, vectors.astype(np.float64), strict=True))
        refused[name] = (
            f"is a matrix of {value.shape[0]} by {value.shape[1]}, name `{entries[0]}` or the like"
        )
    else:
        refused[name] = f"has {value.ndim} dimensions, not one"
