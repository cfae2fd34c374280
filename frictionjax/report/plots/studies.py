"""Monte Carlo studies and sweeps."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.report.canvas import BAND
from frictionjax.report.plots.sheet import COLOURS, Place, labelled, legend, new_axes, units_of
from frictionjax.studies import EstimatorComparison, LevelSweep, Study

_ACROSS = 3  # panels in a row
_LONG = 10.0  # from this ratio of its ends on an axis is logarithmic


def draw_study(study: Study, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Mean and standard error of each number of a `study` over the first entry of its cases that varies; where none
    does, the values of the seeds. `place` as in `new_axes`; `units`: name of a number or an entry -> its unit.

    **Raises:** `InputError` for a study without a finished run.
    """
    rows = study.summary()
    if not rows:
        raise InputError("the study has no finished run", place="`result`", cure="Look at its `failures`")
    numbers = [name for name in rows[0] if f"{name}_stderr" in rows[0]]
    varied = [name for name in study.settings if len({str(row.get(name)) for row in rows}) > 1]
    panels = new_axes(_rows_of(numbers), place)
    for name in numbers:
        if varied:
            _over(panels[name], rows, name, varied, units or {})
        else:
            _seeds(panels[name], study, name, units or {})
    legend(panels[numbers[0]])
    return panels


def _over(
    panel: Axes, rows: list[dict[str, Any]], name: str, varied: list[str], units: Mapping[str, str]
) -> None:
    first, others = varied[0], varied[1:]
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(", ".join(f"{other} = {row[other]}" for other in others), []).append(row)
    for k, (label, group) in enumerate(groups.items()):
        own = [row for row in group if row.get(name) is not None]
        x = [row[first] if _is_number(row[first]) else str(row[first]) for row in own]
        errors = [row[f"{name}_stderr"] or 0.0 for row in own]
        colour = COLOURS[k % len(COLOURS)]
        panel.errorbar(
            x, [row[name] for row in own], errors, fmt="o-", color=colour, markersize=3.5, label=label
        )
    values = [row[first] for row in rows]
    if all(_is_number(value) and value > 0.0 for value in values) and max(values) > _LONG * min(values):
        panel.set_xscale("log")
    panel.set(xlabel=labelled(first, units.get(first, "1")), ylabel=labelled(name, units.get(name, "1")))


def _seeds(panel: Axes, study: Study, name: str, units: Mapping[str, str]) -> None:
    runs = [run for run in study.runs if name in run]
    panel.plot(
        [run["seed"] for run in runs], [run[name] for run in runs], "o", color=COLOURS[0], markersize=3.5
    )
    panel.set(xlabel="seed", ylabel=labelled(name, units.get(name, "1")))


def draw_levels(sweep: LevelSweep, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Stiffness over the level of the excitation, mean and standard deviation over the seeds of a `sweep`; `place` as
    in `new_axes`, `units` as in `plot`."""
    panels = new_axes([["stiffness"]], place)
    panel, known = panels["stiffness"], units_of(units)
    for colour, kind in zip(COLOURS, sweep.excitations, strict=False):
        panel.errorbar(
            sweep.levels,
            sweep.mean(kind),
            sweep.std(kind),
            fmt="o-",
            color=colour,
            markersize=3.5,
            label=kind,
        )
    panel.axhline(sweep.true_stiffness, color=BAND, linewidth=0.9, label="at zero amplitude")
    panel.set_xscale("log")
    panel.set_xlabel("rms of the excitation over break-away")
    panel.set_ylabel(labelled("stiffness", f"{known['force']}/{known['position']}"))
    legend(panel)
    return panels


def draw_comparison(
    comparison: EstimatorComparison, place: Place, units: Mapping[str, str] | None
) -> dict[str, Axes]:
    """Scatter of each estimator of a `comparison` over the Cramer-Rao bound, one panel a parameter, over the noise;
    `place` as in `new_axes`, `units` as in `plot`."""
    names = comparison.parameters
    panels = new_axes(_rows_of(names), place)
    noise, ratio = comparison.noise, comparison.std / comparison.bound
    position = units_of({"position": "m"} | dict(units or {}))["position"]
    for p, name in enumerate(names):
        panel = panels[name]
        for e, estimator in enumerate(comparison.estimators):
            if np.isfinite(ratio[e, :, p]).any():
                colour = COLOURS[e % len(COLOURS)]
                panel.loglog(
                    noise, ratio[e, :, p], "o-", color=colour, markersize=3.5, label=words_of(estimator)
                )
        panel.axhline(1.0, color=BAND, linewidth=0.9)
        panel.set(xlabel=labelled("noise", position), ylabel="scatter over the bound")
        panel.set_title(name, fontsize=8.5)
    legend(panels[names[0]])
    return panels


def words_of(estimator: str) -> str:
    """The name of an `estimator` for a reader."""
    known = {"sk": "Sanathanan-Koerner", "frf_ml": "likelihood of the FRF", "breakaway": "break-away ramp"}
    return known.get(estimator, estimator)


def _rows_of(names: Sequence[str]) -> list[list[str]]:
    across = min(len(names), _ACROSS)
    rows = [list(names[k : k + across]) for k in range(0, len(names), across)]
    rows[-1] += ["."] * (across - len(rows[-1]))
    return rows


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
