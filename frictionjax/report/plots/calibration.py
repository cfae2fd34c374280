"""The calibration of `diagnose`: ranks of true values, reliability of confidences, false names by family."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from frictionjax.report.canvas import BAND
from frictionjax.report.plots.sheet import COLOURS, Place, legend, new_axes, rows_of
from frictionjax.studies.calibration import BINS, Calibration, FalseNames

_RELIABILITY, _FALSE = "reliability", "false names"


def draw_calibration(found: Calibration, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """A rank histogram for each parameter of what was `found`, with the band that 95 % of its bars are in where the
    stated errors are right; the share of right names over their confidence; the rate of false names by family.
    `place` as in `new_axes`; `units` are not needed."""
    names = [one.parameter for one in found.ranks]
    panels = new_axes(rows_of([*names, _RELIABILITY, _FALSE]), place)
    middles = (np.arange(BINS) + 0.5) / BINS
    for one in found.ranks:
        panel = panels[one.parameter]
        panel.axhspan(one.low, one.high, color=BAND, alpha=0.3, linewidth=0, label="95 % band")
        panel.bar(middles, one.counts, width=0.9 / BINS, color=COLOURS[0])
        panel.set(xlabel=f"rank of the true {one.parameter}", ylabel="machines", xlim=(0.0, 1.0))
    _draw_reliability(panels[_RELIABILITY], found)
    _draw_false_names(panels[_FALSE], found)
    if names:
        legend(panels[names[0]])
    return panels


def _draw_reliability(panel: Axes, found: Calibration) -> None:
    panel.plot([0.0, 1.0], [0.0, 1.0], color=BAND, linewidth=0.9, label="as it should be")
    rows = found.reliability
    x, y = np.array([one.confidence for one in rows]), np.array([one.right for one in rows])
    ends = np.array([one.interval for one in rows]).reshape(-1, 2)
    if rows:
        panel.errorbar(x, y, np.abs(ends.T - y), fmt="o", color=COLOURS[1], markersize=3.5)
    panel.set(xlabel="stated confidence", ylabel="share of names that is right", ylim=(-0.03, 1.03))
    legend(panel)


def _draw_false_names(panel: Axes, found: Calibration) -> None:
    rows = [one for one in found.false_names if one.acting != "any"]
    families = list(dict.fromkeys(one.family for one in rows))
    for k, kind in enumerate(dict.fromkeys(one.acting for one in rows)):
        own: list[FalseNames] = [one for one in rows if one.acting == kind]
        x = np.array([families.index(one.family) for one in own]) + 0.2 * k - 0.1
        y = np.array([one.wrong / one.machines for one in own])
        ends = np.array([one.interval for one in own]).reshape(-1, 2)
        panel.errorbar(
            x, y, np.abs(ends.T - y), fmt="o", color=COLOURS[k], markersize=3.5, label=f"{kind} acts"
        )
    panel.set_xticks(range(len(families)), families)
    panel.set(ylabel="machines with a false name", ylim=(-0.03, 1.03))
    legend(panel)
