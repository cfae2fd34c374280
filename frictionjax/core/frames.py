"""Results as tables of pandas and data sets of xarray, which are loaded when they are asked for."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from frictionjax.core.estimate import Estimate

_EXTRA = "frames"


def to_dataframe(
    columns: Mapping[str, Any], units: Mapping[str, str] | None = None, *, index: str | None = None
) -> Any:
    """A pandas `DataFrame`.

    **Arguments:**

    - `columns`: name -> values, all of one length.
    - `units`: column -> its unit; kept in `frame.attrs["units"]`.
    - `index`: the column that becomes the index.

    **Raises:** `ImportError` where pandas is missing, with the command that installs it.
    """
    try:
        import pandas  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise _missing("pandas", "to_dataframe", error) from error
    frame = pandas.DataFrame({name: _plain(values) for name, values in columns.items()})
    frame.attrs["units"] = dict(units or {})
    return frame if index is None else frame.set_index(index)


def to_xarray(
    arrays: Mapping[str, tuple[Sequence[str], Any]],
    coordinates: Mapping[str, Any],
    units: Mapping[str, str] | None = None,
    **about: Any,
) -> Any:
    """An xarray `Dataset`.

    **Arguments:**

    - `arrays`: name -> (names of its dimensions, values).
    - `coordinates`: dimension -> the values along it.
    - `units`: name of an array or a coordinate -> its unit, kept as its attribute `units`.
    - `about`: attributes of the whole.

    **Raises:** `ImportError` where xarray is missing, with the command that installs it.
    """
    values = {name: (tuple(dims), _plain(array)) for name, (dims, array) in arrays.items()}
    places = {name: _plain(array) for name, array in coordinates.items()}
    try:
        import xarray  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise _missing("xarray", "to_xarray", error) from error
    dataset = xarray.Dataset(values, coords=places, attrs=about)
    for name, unit in (units or {}).items():
        dataset[name].attrs["units"] = unit
    return dataset


def records(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """The columns of `rows`, mappings of names to values; None where a row lacks one."""
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def estimate_columns(estimates: Mapping[str, Estimate]) -> dict[str, list[Any]]:
    """The columns `parameter`, `value`, `stderr`, `unit` and `identified` of `estimates` by name."""
    rows = [
        {"parameter": n, "value": e.value, "stderr": e.stderr, "unit": e.unit, "identified": e.identified}
        for n, e in estimates.items()
    ]
    return records(rows)


def _plain(values: Any) -> Any:
    """`values` without JAX: pandas takes its arrays apart number by number."""
    return np.asarray(values) if hasattr(values, "__array__") else values


def _missing(library: str, verb: str, error: ModuleNotFoundError) -> ImportError:
    """What to raise for the `error` that `library` cannot be loaded, which `verb` needs."""
    return ImportError(
        f"`{verb}` needs {library}, which cannot be loaded ({error}): python -m pip install 'frictionjax[{_EXTRA}]'.",
        name=library,
    )
