"""The figure that a picture is drawn on: pyplot, which shows it in a notebook, is loaded when the first is made."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from frictionjax.core import InputError
from frictionjax.report.format import unit_text

Place = Sequence[Axes] | np.ndarray | Axes | Figure
"""Where to draw: the caller's own axes, one a panel, or an empty figure."""

Panels = Sequence[Sequence[str]]
"""The names of the panels, row by row; one that occurs several times covers all its places, "." stays empty."""

PANEL, STACKED = (3.7, 2.5), (5.6, 1.7)  # inches: of a panel, and of one in a stack that shares its axis
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#2b2b2b")
"""Okabe and Ito's colours, for series that have no colour of their own."""


@contextmanager
def new_figure() -> Iterator[Figure]:
    """An empty figure of pyplot, which a notebook shows; closed again when drawing fails.

    It must be made before the report's style is set: with the first figure a notebook also sets what pyplot shows of
    itself, and a style that ends would undo that.
    """
    import matplotlib.pyplot as plt

    figure = plt.figure(layout="constrained")
    try:
        yield figure
    except BaseException:
        plt.close(figure)
        raise


def new_axes(panels: Panels, place: Place, shared: Sequence[str] = ()) -> dict[str, Axes]:
    """The axes of each panel by its name.

    **Arguments:**

    - `panels`: their arrangement in an empty figure.
    - `place`: that figure, or the caller's own axes, in the order of the names.
    - `shared`: names of panels that share their horizontal axis.

    **Raises:** `InputError` when the number of axes is not that of the panels.
    """
    names = list(dict.fromkeys(name for row in panels for name in row if name != "."))
    if not isinstance(place, Figure):
        own = [place] if isinstance(place, Axes) else list(np.ravel(np.asarray(place, dtype=object)))
        if len(own) != len(names):
            raise InputError(
                f"there are {len(own)} axes for {len(names)} panels",
                place="`axes`",
                cure=f"Give one for each of: {', '.join(names)}.",
            )
        return dict(zip(names, own, strict=True))
    width, height = STACKED if len(panels) > 1 and len(panels[0]) == 1 else PANEL
    place.set_size_inches(width * len(panels[0]) + 0.6, height * len(panels) + 0.3)
    place.set_dpi(110)
    rows: list[Any] = [list(row) for row in panels]
    found = place.subplot_mosaic(rows)
    for name in shared[1:]:
        found[name].sharex(found[shared[0]])
    for name in shared[:-1]:
        found[name].tick_params(labelbottom=False)
    return {name: found[name] for name in names}


_ACROSS = 3  # panels in a row


def rows_of(names: Sequence[str]) -> list[list[str]]:
    """An arrangement of panels with these `names`, three in a row."""
    across = min(len(names), _ACROSS)
    rows = [list(names[k : k + across]) for k in range(0, len(names), across)]
    rows[-1] += ["."] * (across - len(rows[-1]))
    return rows


def labelled(name: str, unit: str) -> str:
    """The label of an axis: a `name` and its `unit`, which a ratio has none of."""
    text = unit_text(unit)
    return without_formulas(f"{name} ({text})" if text else name)


def without_formulas(text: str) -> str:
    """The `text` of a user with its dollar signs as such: matplotlib takes what stands between two of them for a
    formula, as it must for the powers of ten of a logarithmic axis."""
    return text.replace("$", r"\$")


def units_of(units: Mapping[str, str] | None) -> dict[str, str]:
    """The names of the units of position, force and input: those in `units`, and for the others "position units" and so
    on."""
    return {kind: (units or {}).get(kind, f"{kind} units") for kind in ("position", "force", "input")}


def per_second(unit: str) -> str:
    """The `unit` over s, as text."""
    return f"({unit})/s" if " " in unit else f"{unit}/s"


def legend(axes: Axes, **how: Any) -> None:
    """A legend of `axes` without a frame, where there is something to explain; `how`: as matplotlib has it."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(frameon=False, fontsize=7.5, **how)


def error_band(
    axes: Axes,
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    half_width: Float[np.ndarray, " n"],
    colour: str,
) -> None:
    """Shade `half_width` about the curve `y` over `x` in `axes`, with the `colour`; arrays of shape `(n,)`."""
    axes.fill_between(x, y - half_width, y + half_width, color=colour, alpha=0.2, linewidth=0)
