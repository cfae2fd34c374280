"""The recordings of a case drawn as they were read, before anything is fitted."""

import io
import os
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from frictionjax.core import InputError
from frictionjax.recordings import Case
from frictionjax.recordings.words import shown
from frictionjax.report import canvas
from frictionjax.report.format import engineering

_MOST = 8
"""Recordings that are drawn; the figure says how many more there are."""


def draw_recordings(case: Case, path: str | Path) -> Path:
    """Draw position and input (or measured force) of each recording of a case over time.

    **Arguments:**

    - `case`: the case; its units label the axes.
    - `path`: the PNG file; an earlier one is replaced, whole or not at all.

    **Returns:** `path`, as a Path.

    **Raises:** `InputError` when the file cannot be written.
    """
    with canvas.drawing(), canvas.plain_text():
        data = _png(case)
    path = Path(path)
    fresh = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            fresh.write_bytes(data)
            fresh.replace(path)
        finally:
            fresh.unlink(missing_ok=True)
    except (OSError, ValueError) as error:  # the second is what a name with a null character gives
        problem = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise InputError(problem, file=shown(path, 120), cure="Choose another file or folder") from error
    return path


def _png(case: Case) -> bytes:
    drawn, plant = case.recordings[:_MOST], case.plant
    figure = Figure(figsize=(9.0, 0.5 + 2.3 * len(drawn)), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(drawn), 2, squeeze=False)
    for (left, right), recording in zip(panels, drawn, strict=True):
        t = np.asarray(recording.t)
        cause = ("input", plant.input_unit, recording.u)
        if recording.drive == "motion" and recording.force is not None:
            cause = ("force", plant.force_unit, recording.force)
        for axes, (name, unit, values) in (
            (left, ("position", plant.position_unit, recording.x)),
            (right, cause),
        ):
            factor, label = engineering(unit, float(np.ptp(values)))
            canvas.line(axes, t, factor * values, canvas.MEASURED, width=0.8)
            axes.set_ylabel(name if label == name else f"{name} ({label})")
            axes.set_xlabel("time (s)")
        role = "fitted" if recording.role == "fit" else "held out"
        left.set_title(f"{shown(recording.name, 40)}, {role}", loc="left", fontsize=9.0)
    if len(case.recordings) > _MOST:
        figure.supxlabel(f"and {len(case.recordings) - _MOST} recordings more", fontsize=9.0)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
