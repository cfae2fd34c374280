"""A sheet: one figure of the paper with its panels and a caption, saved as PNG and as SVG."""

import textwrap
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from frictionjax.report.canvas import BASE, EXTENDED, MEASURED

TWIN, PAPER, BETTER = MEASURED, BASE, EXTENDED
"""Colours: what was measured on a twin, the paper's estimate, and what improves on it."""

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f", "#000000")
"""Okabe and Ito's colours, for series that are alike."""

_CHARACTERS = 17.0  # of the caption in an inch


def sheet(
    title: str, caption: str, *, size: tuple[float, float], rows: int = 1, columns: int = 1, **grid: object
) -> tuple[Figure, Shaped[np.ndarray, "rows columns"]]:
    """An empty figure.

    **Arguments:**

    - `title`: above the panels.
    - `caption`: below them, wrapped to the width; says what is the paper's and what is ours.
    - `size`: width and height, inches.
    - `rows`, `columns`: of panels.
    - `grid`: passed on to `Figure.subplots`.

    **Returns:** the figure and its axes, shape `(rows, columns)`. No pyplot: nothing to close, no window.
    """
    figure = Figure(figsize=size, layout="constrained")
    figure.suptitle(title, fontsize=9.5, x=0.01, ha="left", fontweight="bold")
    text = textwrap.fill(caption, int(_CHARACTERS * size[0]))
    figure.supxlabel(text, fontsize=7.5, x=0.01, ha="left", color="#444444", linespacing=1.35)
    return figure, figure.subplots(rows, columns, squeeze=False, **grid)  # type: ignore[return-value, arg-type]


def thin(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], points: int = 1500
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Every so many samples of a curve `y` over `x`, shape `(n,)`, at most about `points`: an SVG does not need all."""
    every = max(1, x.size // points)
    return x[::every], y[::every]


def legend(axes: Axes, **place: object) -> None:
    """A small legend without a frame; `place` is passed on."""
    axes.legend(frameon=False, fontsize=7, handlelength=1.6, borderaxespad=0.2, **place)  # type: ignore[arg-type]


def save(figure: Figure, file: Path) -> None:
    """Write `figure` to `file` with the endings .png and .svg; the same figure gives the same bytes."""
    figure.savefig(file.with_suffix(".png"), dpi=150, metadata={"Software": "frictionjax"})
    with matplotlib.rc_context({"svg.hashsalt": "frictionjax", "svg.fonttype": "none"}):
        figure.savefig(file.with_suffix(".svg"), metadata={"Date": None})
