"""All use of matplotlib by the report: a figure of stacked panels, lines, bands, and its PNG as a data URI."""

import base64
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float
from matplotlib import patheffects, style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image

from frictionjax.report.series import COLUMNS, envelope

# Okabe and Ito's colours: distinct for colour-blind readers, and in grey print by their lightness.
MEASURED, BASE, EXTENDED, BAND = "#2b2b2b", "#d55e00", "#0072b2", "#9a9a9a"
WIDTH, DPI = 5.2, 192  # inches and dots per inch: twice the density of a plain screen

_STYLE = {
    "font.size": 8.5,
    "axes.labelsize": 8.5,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#777777",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#777777",
    "grid.alpha": 0.22,
    "grid.linewidth": 0.6,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "axes.formatter.useoffset": False,
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "agg.path.chunksize": 0,
    "text.usetex": False,
}


@contextmanager
def drawing() -> Iterator[None]:
    """Draw in the report's own style, whatever the user's matplotlib settings are."""
    with style.context(["default", _STYLE]):
        yield


@contextmanager
def plain_text() -> Iterator[None]:
    """Draw all text as it is. Units and names are text of the user: a dollar sign is one, and no formula begins there.
    Powers of ten on logarithmic axes are formulas, and need another way."""
    with style.context({"text.parse_math": False}):
        yield


_spare: dict[tuple[float, ...], list[tuple[Figure, list[Axes]]]] = {}


@contextmanager
def stack(heights: Sequence[float]) -> Iterator[tuple[Figure, list[Axes]]]:
    """A figure of stacked panels that share the time axis.

    It is emptied when the context ends and reused by the next figure of these heights, because axes and ticks are slow
    to make: the caller sets all limits and labels.

    **Arguments:**

    - `heights`: of the panels, inches, top first.

    **Returns:**

    The figure and its axes, top first. No pyplot: nothing to close, no window, any thread.
    """
    spare = _spare.setdefault(tuple(heights), [])
    try:
        figure, axes = spare.pop()
    except IndexError:
        with plain_text():
            figure, axes = _new_stack(heights)
    with plain_text():
        yield figure, axes
    for panel in axes:
        for artist in (*panel.lines, *panel.collections, *panel.patches, *panel.texts):
            artist.remove()
    spare.append((figure, axes))


def _new_stack(heights: Sequence[float]) -> tuple[Figure, list[Axes]]:
    left, right, bottom, top, gap = 0.62, 0.12, 0.42, 0.08, 0.16  # inches
    height = sum(heights) + gap * (len(heights) - 1) + bottom + top
    figure = Figure(figsize=(WIDTH, height), dpi=DPI)
    axes: list[Axes] = []
    y = height - top
    for room in heights:
        y -= room
        box = (left / WIDTH, y / height, (WIDTH - left - right) / WIDTH, room / height)
        panel = figure.add_axes(box, sharex=axes[0] if axes else None)
        panel.yaxis.set_major_locator(MaxNLocator(5 if room > 1 else 3, steps=[1, 2, 2.5, 5, 10]))
        panel.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
        panel.tick_params(labelbottom=False)
        axes.append(panel)
        y -= gap
    axes[-1].tick_params(labelbottom=True)
    axes[-1].set_xlabel("time (s)")
    figure.align_ylabels(axes)
    return figure, axes


def line(
    axes: Axes,
    t: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    colour: str,
    *,
    dashed: bool = False,
    width: float = 1.1,
) -> None:
    """Draw one series, as an envelope when it is long.

    **Arguments:**

    - `axes`: where.
    - `t`, `y`: time (s) and values, shape `(n,)`.
    - `colour`, `dashed`, `width`: how (points).
    """
    axes.plot(*envelope(t, y), color=colour, linewidth=width, linestyle=(0, (4, 2)) if dashed else "solid")


def band(axes: Axes, t: Float[np.ndarray, " n"], half_width: Float[np.ndarray, " n"]) -> None:
    """Shade plus and minus `half_width` about zero.

    **Arguments:**

    - `axes`: where.
    - `t`, `half_width`: time (s) and half width, shape `(n,)`.
    """
    starts = np.arange(0, t.size, max(1, t.size // COLUMNS))
    widest = np.fmax.reduceat(half_width, starts)
    axes.fill_between(t[starts], -widest, widest, color=BAND, alpha=0.35, linewidth=0)


def mark(axes: Sequence[Axes], start: float, stop: float) -> None:
    """Tint the interval from `start` to `stop` (s) in every panel: the one that the close-up shows."""
    for panel in axes:
        panel.axvspan(start, stop, color="#e69f00", alpha=0.18, linewidth=0)


def note(axes: Axes, words: str) -> None:
    """A short text in the upper right corner of a panel."""
    halo = [patheffects.withStroke(linewidth=2.5, foreground="white", alpha=0.8)]
    axes.text(0.99, 0.96, words, transform=axes.transAxes, ha="right", va="top", path_effects=halo)


def png(figure: Figure) -> str:
    """The figure as a `data:image/png;base64,...` URI with a transparent background.

    A palette of 128 colours is enough for lines and text, and makes the file three times smaller.
    """
    agg = FigureCanvasAgg(figure)
    figure.patch.set_alpha(0.0)
    for axes in figure.axes:
        axes.patch.set_alpha(0.0)
    agg.draw()
    picture = Image.fromarray(np.asarray(agg.buffer_rgba()))
    picture = picture.quantize(128, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    stream = io.BytesIO()
    picture.save(stream, format="png")
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
