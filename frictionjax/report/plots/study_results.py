"""The results of a study, and their summary, over one or two of their dimensions."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Shaped
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.report.plots.sheet import COLOURS, Place, labelled, legend, new_axes, rows_of
from frictionjax.studies.summary import MCSE, STDERR, TRUE, summarise

_LONG = 10.0  # from this ratio of its ends on an axis is logarithmic
_CURVES = len(COLOURS)  # with more values of the second dimension it is a map
_MOST = 12  # panels that are drawn unasked
_SPREAD = ("_mean", "_rate")
_STATISTICS = {
    "mean": "mean of",
    "std": "standard deviation of",
    "bias": "bias of",
    "rmse": "rms error of",
    "coverage": "coverage of",
    "rate": "rate of",
}
"""Last part of a name in a summary -> the words for it."""


class _Panel(NamedTuple):
    """What one panel shows: `label`, its array and its Monte Carlo standard errors, or None."""

    label: str
    array: Any
    error: Any


def draw_results(
    dataset: Any,
    place: Place,
    units: Mapping[str, str] | None,
    over: Sequence[str] | str | None = None,
    names: Sequence[str] | str | None = None,
) -> dict[str, Axes]:
    """Results of a study, or of `summarise`, over one or two dimensions.

    **Arguments:**

    - `dataset`: what `run_study` or `summarise` returns. Of results, means and rates are drawn, over all other
        dimensions; the cases of a random design are points.
    - `place`: as in `new_axes`.
    - `units`: name of a result or a dimension -> its unit, where it is to be another.
    - `over`: one or two dimensions, or, of a random design, axes; by default the first ones.
    - `names`: which results; by default the first twelve.

    **Raises:** `InputError` for a dimension or a result that is not there, and for a summary with further dimensions.
    """
    over = (over,) if isinstance(over, str) else tuple(over or ())
    chosen = (names,) if isinstance(names, str) else tuple(names or ())
    if len(over) > 2:
        raise InputError(f"{len(over)} dimensions are given", place="`over`", cure="Give one or two")
    for name in (*over, *chosen):
        _known(dataset, name, "`over`" if name in over else "`names`")
    known = {str(name): str(dataset[name].attrs.get("units", "1")) for name in dataset.variables} | dict(
        units or {}
    )
    if "failed" in dataset and "case" in dataset.sizes:
        return _points(dataset, place, known, over or _axes_of(dataset)[:1], chosen)
    panels = _panels(dataset, over, chosen)
    if not panels:
        raise InputError(
            "there is nothing to draw", place="`result`", cure="Give a study with numbers as results"
        )
    over = over or tuple(str(d) for d in panels[0].array.dims if panels[0].array.sizes[d] > 1)[:2]
    axes = new_axes(rows_of([panel.label for panel in panels]), place)
    for panel in panels:
        if further := [d for d in panel.array.dims if d not in over and panel.array.sizes[d] > 1]:
            raise InputError(
                f"`{panel.label}` has the further dimensions {', '.join(map(str, further))}",
                place="`over`",
                cure="Choose by dataset.sel(...), or summarise over them",
            )
        _draw(axes[panel.label], panel, over, known)
    legend(axes[panels[0].label])
    return axes


def _panels(dataset: Any, over: tuple[str, ...], chosen: tuple[str, ...]) -> list[_Panel]:
    """What is drawn of results, or of a summary."""
    if "failed" not in dataset:
        with_error = [n for n in map(str, dataset.data_vars) if f"{n}{MCSE}" in dataset]
        names = [n for n in with_error if "quantile" not in dataset[n].dims]
        kept = [n for n in names if n in chosen] if chosen else names[:_MOST]
        return [_Panel(name, dataset[name].squeeze(), dataset[f"{name}{MCSE}"].squeeze()) for name in kept]
    design = [str(d) for d in dataset["failed"].dims]
    over = over or tuple(d for d in design if d != "repeat" and dataset.sizes[d] > 1)[:2]
    others = [d for d in design if d not in over]
    found = summarise(dataset, over=others) if others else None
    beside = {f"{name}{end}" for name in dataset.data_vars for end in (STDERR, TRUE)}
    panels = []
    for name in chosen or [n for n in map(str, dataset.data_vars) if n not in beside and n != "failed"]:
        array = dataset[name]
        if array.dtype.kind not in "fib" or set(array.dims) != set(design):
            continue
        if found is None:
            panels.append(_Panel(name, array.astype(float), None))
            continue
        ends = [f"{name}{end}" for end in _SPREAD if f"{name}{end}" in found]
        panels += [_Panel(name, found[label], found[f"{label}{MCSE}"]) for label in ends]
    return panels if chosen else panels[:_MOST]


def _draw(axes: Axes, panel: _Panel, over: tuple[str, ...], units: Mapping[str, str]) -> None:
    array = panel.array.squeeze()
    order = [d for d in over if d in array.dims]
    array = array.transpose(*order)
    label = labelled(_words(panel), units.get(panel.label, "1"))
    x = _values(panel.array, order[0]) if order else np.zeros(1)
    if len(order) == 2 and array.sizes[order[1]] > _CURVES:
        y = _values(panel.array, order[1])
        mesh = axes.pcolormesh(x, y, array.values.T, shading="nearest")
        axes.figure.colorbar(mesh, ax=axes, label=label)
        axes.set(
            xlabel=labelled(_spaced(order[0]), units.get(order[0], "1")),
            ylabel=labelled(_spaced(order[1]), units.get(order[1], "1")),
        )
        _log(axes.set_yscale, y)
    else:
        error = None if panel.error is None else panel.error.squeeze().transpose(*order)
        seconds = array[order[1]].values if len(order) == 2 else [None]
        for k, second in enumerate(seconds):
            own = array.values.reshape(len(x), -1)[:, k]
            spread = None if error is None else error.values.reshape(len(x), -1)[:, k]
            name = None if second is None else f"{_spaced(order[1])} = {_short(second)}"
            axes.errorbar(
                x, own, spread, fmt="o-", color=COLOURS[k % len(COLOURS)], markersize=3.5, label=name
            )
        along = labelled(_spaced(order[0]), units.get(order[0], "1")) if order else "all cases"
        axes.set(xlabel=along, ylabel=label)
    _log(axes.set_xscale, x)


def _points(
    dataset: Any, place: Place, units: Mapping[str, str], over: tuple[str, ...], chosen: tuple[str, ...]
) -> dict[str, Axes]:
    """Each case of a random design as a point over one axis, coloured by a second."""
    beside = {f"{name}{end}" for name in dataset.data_vars for end in (STDERR, TRUE)}
    names = chosen or [
        n
        for n in map(str, dataset.data_vars)
        if n not in beside and n != "failed" and dataset[n].dims == ("case",)
    ]
    names = [n for n in names if dataset[n].dtype.kind in "fib"]
    if not names:
        raise InputError(
            "there is nothing to draw", place="`result`", cure="Give a study with numbers as results"
        )
    panels = new_axes(rows_of(names if chosen else names[:_MOST]), place)
    fine = ~dataset["failed"].values
    x = dataset[over[0]].values[fine]
    for name, axes in panels.items():
        y = dataset[name].values[fine].astype(float)
        if len(over) == 2:
            drawn = axes.scatter(x, y, c=dataset[over[1]].values[fine], s=6.0)
            axes.figure.colorbar(drawn, ax=axes, label=labelled(_spaced(over[1]), units.get(over[1], "1")))
        else:
            axes.plot(x, y, "o", color=COLOURS[0], markersize=2.5)
        axes.set(
            xlabel=labelled(_spaced(over[0]), units.get(over[0], "1")),
            ylabel=labelled(_spaced(name), units.get(name, "1")),
        )
        _log(axes.set_xscale, x)
    return panels


def _axes_of(dataset: Any) -> tuple[str, ...]:
    """The axes of a random design: its coordinates beside the number of the case."""
    return tuple(str(n) for n in dataset.coords if n != "case") or ("case",)


def _known(dataset: Any, name: str, place: str) -> None:
    if name not in dataset.variables and name not in dataset.sizes:
        raise InputError(
            f"there is no `{name}`",
            place=place,
            cure=f"Choose from: {', '.join(map(str, dataset.variables))}",
        )


def _values(array: Any, dimension: str) -> Any:
    """The places along a `dimension`: numbers, or texts."""
    values = array[dimension].values
    return values if values.dtype.kind in "fi" else np.asarray([str(value) for value in values])


def _log(set_scale: Any, values: Shaped[np.ndarray, " k"]) -> None:
    if values.dtype.kind in "fi" and values.min() > 0.0 and values.max() > _LONG * values.min():
        set_scale("log")


def _words(panel: _Panel) -> str:
    """What a panel shows, in words: of a summary, which has errors, the statistic as well."""
    name, _, statistic = panel.label.rpartition("_")
    if panel.error is None or statistic not in _STATISTICS:
        return _spaced(panel.label)
    return f"{_STATISTICS[statistic]} {_spaced(name)}"


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float | np.floating) else str(value)
