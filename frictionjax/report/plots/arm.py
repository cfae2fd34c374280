"""The joints of an arm side by side: what the rigid bodies leave of each torque, and the errors of the friction."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

from frictionjax.arm import ArmDiagnosis
from frictionjax.core import InputError
from frictionjax.report.canvas import BAND, BASE, EXTENDED, MEASURED
from frictionjax.report.format import words
from frictionjax.report.plots.sheet import Place, labelled, legend, new_axes, without_formulas

_BAR = 0.26  # of the distance of two joints
_ROW = 0.62  # inches
_FEW_DECADES = 50.0  # ratio of the ends of an axis up to which it has ticks within its decades
_TORQUES = {
    "torque": (MEASURED, "torque"),
    "left_as_given": (BASE, "left on held-out logs, model as given"),
    "left_holdout": (EXTENDED, "left on held-out logs, model refitted"),
}
_ERRORS = {"error_base": (BASE, "base model"), "error_extended": (EXTENDED, "extended model")}
_EXTENDED = ("named", "unknown")  # verdicts with an extended model


def draw_arm(diagnosis: ArmDiagnosis, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """For each joint of a `diagnosis` the torque, and what the rigid bodies leave of it; and the error of its friction
    on the held-out logs, of the base and of the extended model, with its noise floor; `place` as in `new_axes`, `units`
    are not needed.

    **Raises:** `InputError` for an arm without joints.
    """
    rows = diagnosis.table()
    if not rows:
        raise InputError("the arm has no joints", place="`result`", cure="Diagnose a log with one")
    panels = new_axes([["torque", "error"]], place)
    if isinstance(place, Figure):
        place.set_size_inches(8.4, max(2.8, 1.2 + _ROW * len(rows)))
    found = {str(row["unit"]) for row in rows}
    unit = found.pop() if len(found) == 1 else ""
    at = np.arange(len(rows), dtype=float)[::-1]
    left, right = panels["torque"], panels["error"]
    _bars(left, at, rows, _TORQUES)
    judged = [one if one["verdict"] in _EXTENDED else {**one, "error_extended": math.nan} for one in rows]
    _bars(right, at, judged, _ERRORS)
    floors = np.array([row["noise_floor"] for row in rows])
    right.vlines(floors, at - 0.4, at + 0.4, color=BAND, linewidth=1.6, label="noise floor")
    left.set_yticks(at, [_joint(row, unit) for row in rows])
    right.set_yticks(at, [_answer(row) for row in rows])
    _logarithmic(left, [row[key] for row in rows for key in _TORQUES])
    _logarithmic(right, [*floors.tolist(), *(row[key] for row in judged for key in _ERRORS)])
    for panel, name in ((left, "torque, rms"), (right, "force error 0.1 s ahead, held-out logs, rms")):
        panel.set_ylim(-0.6, len(rows) - 0.4)
        panel.grid(axis="y", visible=False)
        panel.set_xlabel(labelled(name, unit or "unit of the joint"))
        # Above the axes: bars of any length leave no corner free.
        legend(panel, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return panels


def _logarithmic(panel: Axes, sizes: Sequence[float]) -> None:
    """A logarithmic axis that begins below the smallest of the `sizes`, so that each bar has a length."""
    panel.set_xscale("log")
    drawn = [size for size in sizes if math.isfinite(size) and size > 0.0] or [1.0]
    low, high = 0.5 * min(drawn), 1.3 * max(drawn)
    panel.set_xlim(low, high)
    panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _FEW_DECADES * low else (1.0,)))
    panel.xaxis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf)))
    panel.xaxis.set_minor_formatter(NullFormatter())


def _bars(
    panel: Axes,
    at: Float[np.ndarray, " n"],
    rows: Sequence[Mapping[str, Any]],
    keys: Mapping[str, tuple[str, str]],
) -> None:
    """A bar for each of the `keys` of each of the `rows`, one below the other, in its colour and with its words."""
    for place, (key, (colour, label)) in enumerate(keys.items()):
        sizes = np.array([row[key] for row in rows], dtype=float)
        panel.barh(at - (place - 0.5 * (len(keys) - 1)) * _BAR, sizes, _BAR, color=colour, label=label)


def _joint(row: Mapping[str, Any], unit: str) -> str:
    name = str(row["joint"])
    return without_formulas(name) if unit else labelled(name, str(row["unit"]))


def _answer(row: Mapping[str, Any]) -> str:
    """The joint and what was found of it, an effect a line."""
    effects = [words(name) for name in str(row["effects"]).split(", ") if name]
    return without_formulas(f"{row['joint']}: " + (",\n".join(effects) or str(row["verdict"])))
