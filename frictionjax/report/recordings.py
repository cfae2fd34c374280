"""The recordings of a case drawn as they were read, before anything is fitted."""

import io
import os
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from frictionjax.core import InputError
from frictionjax.recordings import Case
from frictionjax.recordings.words import shown
from frictionjax.report.canvas import drawing
from frictionjax.report.plots.recordings import draw_case


def draw_recordings(case: Case, path: str | Path) -> Path:
    """Draw position and input (or measured force) of each recording of a case over time.

    **Arguments:**

    - `case`: the case; its units label the axes.
    - `path`: the PNG file; an earlier one is replaced, whole or not at all.

    **Returns:** `path`, as a Path.

    **Raises:** `InputError` when the file cannot be written.
    """
    with drawing():
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
    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    draw_case(case, figure, None)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
