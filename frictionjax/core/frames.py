"""Results as tables of pandas and data sets of xarray, which are loaded when they are asked for."""

import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core.estimate import Estimate
from frictionjax.core.files import to_disk

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
        import pandas  # type: ignore[import-not-found]
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
    dataset = _xarray("to_xarray", _EXTRA).Dataset(values, coords=places, attrs=about)
    for name, unit in (units or {}).items():
        dataset[name].attrs["units"] = unit
    return dataset


def write_zarr(dataset: Any, folder: Path) -> None:
    """Write the xarray `dataset` into a new `folder`, as a store of Zarr's format 3, and wait until it is on the disk.

    **Raises:** `ImportError` where zarr is missing, with the command that installs it; `OSError` where it cannot be
        written.
    """
    require_studies("write_zarr")
    # Zarr's third format knows no metadata of several arrays in one place.
    dataset.to_zarr(folder, mode="w-", zarr_format=3, consolidated=False)
    for path in (*folder.rglob("*"), folder):
        to_disk(path)


def read_zarr(folder: Path) -> Any:
    """The xarray `Dataset` in the `folder`, a store of Zarr's format 3; arrays are read when they are asked for.

    **Raises:** `ImportError` where zarr is missing, with the command that installs it; `OSError` or `ValueError` where
        the folder is no such store.
    """
    return require_studies("read_zarr").open_zarr(folder, zarr_format=3, consolidated=False, chunks=None)


def require_studies(verb: str) -> Any:
    """The module xarray, where zarr is installed, too, for the `verb` that needs both.

    **Raises:** `ImportError` where one is missing, with the command that installs it.
    """
    if importlib.util.find_spec("zarr") is None:
        raise _missing("zarr", verb, ModuleNotFoundError("it is not installed"), "studies")
    return _xarray(verb, "studies")


def is_dataset(value: Any) -> bool:
    """Whether `value` is an xarray `Dataset`; xarray is not loaded for the question."""
    known = sys.modules.get("xarray")
    return known is not None and isinstance(value, known.Dataset)


def _xarray(verb: str, extra: str) -> Any:
    """The module xarray, for the `verb`; where it is missing, the `extra` is named."""
    try:
        import xarray  # type: ignore[import-not-found]
    except ModuleNotFoundError as error:
        raise _missing("xarray", verb, error, extra) from error
    return xarray


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


def _missing(library: str, verb: str, error: ModuleNotFoundError, extra: str = _EXTRA) -> ImportError:
    """What to raise for the `error` that `library` of the `extra` cannot be loaded, which `verb` needs."""
    return ImportError(
        f"`{verb}` needs {library}, which cannot be loaded ({error}): python -m pip install 'frictionjax[{extra}]'.",
        name=library,
    )
