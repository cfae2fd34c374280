"""A diagnosis at a glance: how far the models are from what was measured, and where."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.diagnosis import Diagnosis
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import MismatchBin
from frictionjax.report.canvas import BAND, BASE, EXTENDED, band, line
from frictionjax.report.figures import answer_of
from frictionjax.report.format import engineering, quantity, words
from frictionjax.report.plots.sheet import Place, labelled, legend, new_axes, without_formulas
from frictionjax.report.series import holdout_first, is_extended, limits, zoom

_MOST_BINS = 12


def draw_diagnosis(diagnosis: Diagnosis, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Prediction errors and residual force of the recording that shows most of a `diagnosis`, and the axis of its map
    where the mismatch is; `place` as in `new_axes`, `units` are those of the case.

    **Raises:** `InputError` for a diagnosis without recordings.
    """
    if not diagnosis.recordings:
        raise InputError("the diagnosis has no recordings", place="`result`", cure="Diagnose a case again")
    mapped = [["error", "error", "where"], ["force", "force", "where"]]
    panels = new_axes(mapped if diagnosis.mismatch else [["error"], ["force"]], place, ("error", "force"))
    extended = is_extended(diagnosis)
    recording = _telling(diagnosis, extended)
    _errors(panels["error"], diagnosis, recording, extended)
    _forces(panels["force"], diagnosis, recording, extended)
    window = zoom(recording)
    t = recording.t[window]
    for name in ("error", "force"):
        panels[name].set_xlim(float(t[0]), float(t[-1]))
    panels["force"].set_xlabel("time (s)")
    if diagnosis.mismatch:
        _where(panels["where"], diagnosis.mismatch, extended)
    return panels


def _telling(diagnosis: Diagnosis, extended: bool) -> RecordingFit:
    """The recording that the extended model improves most; without one, that with the largest error over its noise
    floor. A held-out recording if there is any."""
    ordered = holdout_first(diagnosis.recordings)
    held_out = [one for one in ordered if one.role == "holdout"] or ordered

    def worth(one: RecordingFit) -> float:
        least = one.prediction_rmse_extended if extended else one.noise_floor
        return one.prediction_rmse_base / least if least > 0.0 else 0.0

    return max(held_out, key=worth)


def _errors(panel: Axes, diagnosis: Diagnosis, recording: RecordingFit, extended: bool) -> None:
    answer, unit, measured = answer_of(recording, diagnosis.plant)
    window = zoom(recording)
    t = recording.t[window]
    models = [("base model", recording.predicted_base, recording.prediction_rmse_base, BASE)]
    if extended:
        models.append(
            ("extended model", recording.predicted_extended, recording.prediction_rmse_extended, EXTENDED)
        )
    errors = [(predicted - measured)[window] for _, predicted, _, _ in models]
    factor, label = engineering(unit, max(float(np.nanmax(np.abs(error), initial=0.0)) for error in errors))
    band(panel, t, np.full(t.size, 2.0 * factor * recording.noise_floor))
    for (name, _, rmse, colour), error in zip(models, errors, strict=True):
        line(panel, t, factor * error, colour)
        panel.plot([], [], color=colour, label=without_formulas(f"{name}: {quantity(rmse, unit)} rms"))
    panel.set_ylim(limits(*(factor * error for error in errors), margin=0.1))
    panel.set_ylabel(labelled(f"{answer} error, 0.1 s ahead", label), fontsize=7.5)
    role = "held out" if recording.role == "holdout" else "fitted"
    title = f"{diagnosis.case}: {diagnosis.verdict}. Close-up of {recording.name} ({role})"
    panel.set_title(without_formulas(title), fontsize=8.5)
    legend(panel, loc="best")


def _forces(panel: Axes, diagnosis: Diagnosis, recording: RecordingFit, extended: bool) -> None:
    window = zoom(recording)
    t, std = recording.t[window], recording.residual_force_std[window]
    forces = [(recording.residual_force[window], BASE)]
    if extended:
        forces.append((recording.residual_force_extended[window], EXTENDED))
    largest = max(float(np.nanmax(np.abs(force), initial=0.0)) for force, _ in forces)
    factor, label = engineering(diagnosis.plant.shown_force, largest)
    band(panel, t, 2.0 * factor * std)
    for force, colour in forces:
        line(panel, t, factor * force, colour)
    panel.set_ylim(limits(*(factor * force for force, _ in forces), margin=0.1))
    panel.set_ylabel(labelled("residual force", label))


def _where(panel: Axes, mismatch: Sequence[MismatchBin], extended: bool) -> None:
    by_axis: dict[str, list[MismatchBin]] = {}
    for cell in mismatch:
        by_axis.setdefault(cell.axis, []).append(cell)
    if len(by_axis) > 1:
        by_axis.pop("frequency", None)  # its bins always differ: no model of friction acts at the highest
    # The axis whose bins differ most in power: there a place can be pointed at.
    name = max(by_axis, key=lambda axis: _contrast(by_axis[axis]))
    strongest = sorted(by_axis[name], key=lambda cell: -cell.excess)[:_MOST_BINS]
    cells = [cell for cell in by_axis[name] if cell in strongest]
    place = np.arange(len(cells))[::-1]
    after = extended and any(math.isfinite(cell.excess_extended) for cell in cells)
    height = 0.38 if after else 0.7
    panel.barh(
        place + (0.2 if after else 0.0),
        [cell.excess for cell in cells],
        height,
        color=BASE,
        label="base model",
    )
    if after:
        reached = [cell.excess_extended for cell in cells]
        panel.barh(place - 0.2, reached, height, color=EXTENDED, label="extended model")
    panel.set_yticks(place, [cell.bin for cell in cells], fontsize=7)
    panel.set_xscale("log")
    panel.axvline(1.0, color=BAND, linewidth=0.9)
    panel.set(xlabel="error power over the noise floor")
    panel.set_title(f"where the mismatch is: {words(name)}", fontsize=8.5)
    legend(panel, loc="best")


def _contrast(cells: Sequence[MismatchBin]) -> float:
    powers = [cell.excess for cell in cells if math.isfinite(cell.excess) and cell.excess > 0.0]
    return max(powers) / min(powers) if powers else 0.0
