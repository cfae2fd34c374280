"""The level sweep, and the comparison of estimators."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from frictionjax.report.canvas import BAND
from frictionjax.report.plots.sheet import COLOURS, Place, labelled, legend, new_axes, rows_of, units_of
from frictionjax.studies import EstimatorComparison, LevelSweep


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
    panels = new_axes(rows_of(names), place)
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
