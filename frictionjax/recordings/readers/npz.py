"""NumPy archives: `.npz`. Pickled objects are never loaded."""

from pathlib import Path

import numpy as np

from frictionjax.core import InputError
from frictionjax.recordings.readers.arrays import ArrayTable, Collected
from frictionjax.recordings.words import shown


def open_npz(path: Path) -> ArrayTable:
    """Open a NumPy archive.

    **Arguments:**

    - `path`: an existing `.npz` file.

    **Returns:** its table: arrays under their names, columns of a matrix as `data[:,0]`.

    **Raises:** `InputError` for a damaged file, and one without a vector of numbers.
    """
    found = Collected("array")
    try:
        # A stream of ours is closed whatever happens.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            if isinstance(archive, np.ndarray):
                raise InputError("is a single array", file=shown(path, 200), cure="Save with numpy.savez")
            for name in archive.files:
                try:
                    values = archive[name]
                except ValueError as error:  # an array of objects, which only a pickle holds
                    found.refused[name] = f"is not read ({shown(error, 80)})"
                    continue
                if values.dtype.names is None:
                    found.add(name, values)
                else:
                    for field in values.dtype.names:
                        found.add(f"{name}.{field}", values[field])
    except InputError:
        raise
    except Exception as error:  # whatever a damaged file makes of NumPy
        raise InputError(
            f"is not a NumPy archive that can be read ({shown(error, 80)})",
            file=shown(path, 200),
            cure="Save it again with numpy.savez",
        ) from None
    return found.table(path)
