"""The result of a study as an xarray `Dataset`: named dimensions, coordinates, units, and which cases failed."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Shaped

from frictionjax.core import InputError
from frictionjax.core.frames import to_xarray
from frictionjax.studies.shards import Shard
from frictionjax.studies.study import Study
from frictionjax.studies.task import missing


def dataset_of(study: Study, shards: Iterable[Shard], about: dict[str, Any]) -> Any:
    """The data set of a finished `study`.

    **Arguments:**

    - `study`: the study.
    - `shards`: all its finished cases.
    - `about`: what the attribute `study` of the data set says.

    **Raises:** `InputError` where two cases have results of different shapes, or a result has the name of an axis.
    """
    size, shape = study.design.size, study.design.shape
    values: dict[str, Shaped[np.ndarray, "n ..."]] = {}
    reasons = np.full(size, "", dtype=object)
    done = np.zeros(size, bool)
    for shard in shards:
        for name, part in shard.outcome.values.items():
            if name not in values:
                values[name] = missing(part, size)
            _check(name, values[name], part)
            values[name][shard.places] = part
        reasons[shard.places] = shard.outcome.reasons
        done[shard.places] = True
    assert done.all()  # a study ends when every case is finished
    coordinates = study.design.table().coordinates()
    if taken := {*values} & ({*coordinates} | {"failed", "reason"}):
        name = taken.pop()
        raise InputError(
            f"the result `{name}` has the name of a coordinate",
            place="`task`",
            cure=f"Return it under another name, such as `{name}_estimate`",
        )
    arrays: dict[str, tuple[tuple[str, ...], Any]] = {}
    for name, array in values.items():
        own = study.task.dims.get(name, tuple(f"{name}_{k}" for k in range(array.ndim - 1)))
        if len(own) != array.ndim - 1:
            raise InputError(
                f"`dims` names {len(own)} axes of `{name}`, which has {array.ndim - 1}", place="`task`"
            )
        arrays[name] = ((*shape, *own), array.reshape(*shape.values(), *array.shape[1:]))
    arrays["failed"] = (tuple(shape), (reasons != "").reshape(*shape.values()))
    arrays["reason"] = (tuple(shape), reasons.reshape(*shape.values()))
    plain = {name: column for name, (dimension, column) in coordinates.items() if dimension == name}
    beside = {
        name: ((dimension,), column) for name, (dimension, column) in coordinates.items() if dimension != name
    }
    units = {axis.name: axis.unit for axis in study.design.axes}
    units |= {name: study.task.units.get(name, "1") for name in values if values[name].dtype != object}
    dataset = to_xarray(arrays | beside, plain, units, study=about)
    return dataset.set_coords(list(beside)) if beside else dataset


def _check(name: str, known: Shaped[np.ndarray, "n ..."], part: Shaped[np.ndarray, "k ..."]) -> None:
    if known.shape[1:] != part.shape[1:] or known.dtype != part.dtype:
        raise InputError(
            f"the result `{name}` is {known.dtype} of shape {known.shape[1:]} in one case and {part.dtype} of shape "
            f"{part.shape[1:]} in another",
            place="`task`",
            cure="Return one kind of array in all cases",
        )
