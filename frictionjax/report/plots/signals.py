"""A simulated experiment over time."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.report.format import engineering
from frictionjax.report.plots.sheet import COLOURS, Place, labelled, new_axes, per_second, units_of
from frictionjax.report.series import envelope
from frictionjax.simulation import Trajectory


def draw_trajectory(path: Trajectory, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Position, velocity and friction force of a `path` over time; `place` as in `new_axes`, `units` as in `plot`."""
    t = np.asarray(path.t)
    if t.ndim != 1:
        raise InputError(
            f"the trajectory is a batch of shape {t.shape[:-1]}",
            place="`result`",
            cure="Draw one of it: `jax.tree.map(lambda leaf: leaf[i], path).plot()`.",
        )
    panels = new_axes([["x"], ["v"], ["friction"]], place, ("x", "v", "friction"))
    known = units_of(units)
    speed = per_second(known["position"])
    rows = (
        ("x", "position", known["position"]),
        ("v", "velocity", speed),
        ("friction", "friction", known["force"]),
    )
    for name, words, unit in rows:
        values = np.asarray(getattr(path, name))
        factor, label = engineering(unit, float(np.max(np.abs(values), initial=0.0)))
        panels[name].plot(*envelope(t, factor * values), color=COLOURS[0])
        panels[name].set_ylabel(labelled(words, label))
    panels["friction"].set_xlabel("time (s)")
    return panels
