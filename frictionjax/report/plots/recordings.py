"""What was measured, before anything is fitted: a recording channel by channel, and the recordings of a case."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from frictionjax.core import InputError
from frictionjax.core.quantities import DisplayUnit
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.recordings.words import shown
from frictionjax.report.canvas import BASE, MEASURED, line
from frictionjax.report.format import engineering
from frictionjax.report.plots.sheet import (
    COLOURS,
    Place,
    labelled,
    legend,
    new_axes,
    per_second,
    units_of,
    without_formulas,
)

_MOST = 8  # recordings of a case that are drawn
_KINDS = ("position", "force", "input")
_OF_THE_FILE = "unit of the file"


def draw_recording(recording: Recording, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Every channel of a `recording` over time; `place` as in `new_axes`, `units` as in `plot`, for a recording that
    knows no plant."""
    known = _units(recording.plant, units)
    rows = _channels(recording, known)
    names = [name for name, *_ in rows]
    panels = new_axes([[name] for name in names], place, names)
    for name, words, unit, values in rows:
        _curve(panels[name], recording, words, unit, values)
    beside = {"reference": ("x", COLOURS[4])}
    beside["simulated"] = ("force" if recording.drive == "motion" else "x", BASE)
    for name, (panel, colour) in beside.items():
        values = getattr(recording, name)
        if values is not None and panel in panels:
            of = next(row for row in rows if row[0] == panel)
            factor, _ = engineering(_displayed(recording, of[2]), _span(of[3]))
            line(panels[panel], np.asarray(recording.t), factor * np.asarray(values), colour, dashed=True)
            panels[panel].lines[0].set_label("measured")
            panels[panel].lines[-1].set_label(name)
    panels[names[0]].set_title(_title(recording), fontsize=8.5)
    panels[names[-1]].set_xlabel("time (s)")
    for panel in panels.values():
        legend(panel, loc="best")
    return panels


def draw_case(case: Case, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Position and input (or measured force) of each recording of a `case`, a row each; `place` as in `new_axes`,
    `units` as in `plot`, for units that the case does not say.

    **Raises:** `InputError` for a case without recordings.
    """
    if not case.recordings:
        raise InputError("the case has no recordings", place="`result`", cure="Give a case with one")
    drawn, known = case.recordings[:_MOST], _units(case.plant, units)
    names = [(f"{k} position", f"{k} cause") for k in range(len(drawn))]
    panels = new_axes(names, place)
    for (left, right), recording in zip(names, drawn, strict=True):
        cause = ("input", known["input"], recording.u)
        if recording.drive == "motion" and recording.force is not None:
            cause = ("force", known["force"], recording.force)
        _curve(panels[left], recording, "position", known["position"], recording.x)
        _curve(panels[right], recording, *cause)
        panels[left].set_title(_title(recording), loc="left", fontsize=8.5)
        for name in (left, right):
            panels[name].set_xlabel("time (s)")
    left_out = len(case.recordings) - len(drawn)
    if left_out and isinstance(place, Figure):
        more = f"and {left_out} more recording{'s' * (left_out != 1)}"
        place.supxlabel(more, fontsize=9.0)
    return panels


def _channels(
    recording: Recording, units: Mapping[str, str]
) -> list[tuple[str, str, str, Float[np.ndarray, " n"]]]:
    """Name, words, unit and values of each channel that has a panel of its own."""
    imposed = recording.drive == "motion"
    rows = [
        ("x", "position", units["position"], recording.x),
        ("v", "velocity", per_second(units["position"]), recording.v),
        ("u", "input", units["input"], None if imposed and recording.force is not None else recording.u),
        ("force", "force", units["force"], recording.force),
        # These stay in the unit of their column, which a recording does not keep.
        ("temperature", "temperature", "K or °C", recording.temperature),
        ("normal_force", "normal force", _OF_THE_FILE, recording.normal_force),
        ("supply", "supply", _OF_THE_FILE, recording.supply),
    ]
    return [(name, words, unit, values) for name, words, unit, values in rows if values is not None]


def _curve(panel: Axes, recording: Recording, words: str, unit: str, values: Float[np.ndarray, " n"]) -> None:
    factor, label = engineering(_displayed(recording, unit), _span(values))
    line(panel, np.asarray(recording.t), factor * np.asarray(values), MEASURED, width=0.8)
    panel.set_ylabel(labelled(words, label))


def _displayed(recording: Recording, unit: str) -> str | DisplayUnit:
    """What a `unit` of the `recording` is shown in: that of its file, where it was converted."""
    return unit if recording.plant is None else recording.plant.displayed(unit)


def _span(values: Float[np.ndarray, " n"]) -> float:
    finite = np.asarray(values)[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _units(plant: Plant | None, units: Mapping[str, str] | None) -> dict[str, str]:
    """The units of position, force and input: those that the `plant` knows, else those in `units`."""
    known = {} if plant is None else {kind: getattr(plant, f"{kind}_unit") for kind in _KINDS}
    # A plant whose units nobody said has the kind of the unit in its place.
    return units_of({**(units or {}), **{kind: unit for kind, unit in known.items() if unit != kind}})


def _title(recording: Recording) -> str:
    role = "held out" if recording.role == "holdout" else "fitted"
    return without_formulas(f"{shown(recording.name, 40)}, {role}")
