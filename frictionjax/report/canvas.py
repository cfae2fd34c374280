"""The style of what is drawn with matplotlib, its lines and bands."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float
from matplotlib import style
from matplotlib.axes import Axes

from frictionjax.report.series import COLUMNS, envelope

# Okabe and Ito's colours: distinct for colour-blind readers, and in grey print by their lightness.
MEASURED, BASE, EXTENDED, BAND = "#2b2b2b", "#d55e00", "#0072b2", "#9a9a9a"

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
