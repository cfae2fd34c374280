"""What a fit found: the friction that it describes, and how its estimates depend on each other."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Float
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.estimation import Bootstrap, FitResult, Profile
from frictionjax.report.canvas import BAND, EXTENDED, MEASURED
from frictionjax.report.format import engineering
from frictionjax.report.plots.sheet import (
    COLOURS,
    Place,
    error_band,
    labelled,
    legend,
    new_axes,
    per_second,
    rows_of,
    units_of,
)
from frictionjax.simulation import simulate_imposed

_NORMAL_95 = 1.96
_SPEEDS = np.geomspace(0.01, 100.0, 161)  # over the Stribeck velocity
_LOOPS = (0.3, 0.6, 1.0)  # amplitudes over the deflection at break-away
_QUARTER = 100  # samples of a quarter of a loop
_CYCLES = 6  # until the loop is closed; the last one is drawn


def draw_fit(result: FitResult, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Friction against velocity, presliding loops and correlations of a `result`; `place` as in `new_axes`,
    `units` as in `plot`."""
    panels = new_axes([["stribeck", "loops", "correlation"]], place)
    known = units_of({**_units_of(result), **(units or {})})
    _stribeck(panels["stribeck"], result, known)
    _loops(panels["loops"], result, known)
    _correlation(panels["correlation"], result)
    return panels


def draw_profile(profile: Profile, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Deviance of a `profile` with the parabola of its standard error; `place` as in `new_axes`, `units` are
    not needed."""
    panels = new_axes([["deviance"]], place)
    panel = panels["deviance"]
    order = np.argsort(profile.values)
    values, deviance = profile.values[order], profile.deviance[order]
    here = int(np.searchsorted(values, profile.value))
    values, deviance = np.insert(values, here, profile.value), np.insert(deviance, here, 0.0)
    panel.plot(values, deviance, "o-", color=COLOURS[0], markersize=3.5, label="profile")
    fine = np.linspace(values[0], values[-1], 200)
    if np.isfinite(profile.stderr) and profile.stderr > 0.0:
        parabola = ((fine - profile.value) / profile.stderr) ** 2
        panel.plot(fine, parabola, color=MEASURED, linewidth=0.9, linestyle="dashed", label="standard error")
    panel.axhline(float(scipy.stats.chi2.ppf(0.95, 1)), color=BAND, linewidth=0.9)
    for end in filter(np.isfinite, profile.interval()):
        panel.axvline(end, color=BAND, linewidth=0.8, linestyle="dotted")
    panel.set(xlabel=labelled(profile.name, profile.unit), ylabel="deviance (the line: 95 %)")
    panel.locator_params(axis="x", nbins=4)  # ticks of a narrow range have many digits
    legend(panel)
    return panels


def draw_bootstrap(found: Bootstrap, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Histogram of the refits of each parameter that was `found`, with the estimate and the basic 95 % interval;
    `place` as in `new_axes`; `units`: of parameters by name, where the result has none.

    **Raises:** `InputError` where no refit is finite.
    """
    panels = new_axes(rows_of(found.names), place)
    known = {**(units or {}), **dict(zip(found.names, found.units, strict=False))}
    for k, name in enumerate(found.names):
        panel, values = panels[name], found.values[:, k]
        values = values[np.isfinite(values)]
        if not values.size:
            raise InputError(
                f"no refit of `{name}` is finite", place="`result`", cure="Draw from a fit that converged"
            )
        panel.hist(values, bins="sturges", color=COLOURS[0], alpha=0.75, label="refits")
        panel.axvline(float(found.estimate[k]), color=MEASURED, linewidth=1.4, label="estimate")
        for end in found.interval(name):
            panel.axvline(end, color=COLOURS[1], linewidth=0.9, linestyle="dashed")
        panel.plot([], [], color=COLOURS[1], linewidth=0.9, linestyle="dashed", label="95 % interval")
        panel.set(xlabel=labelled(name, known.get(name, f"{name} units")), ylabel="refits (count)")
        panel.locator_params(axis="x", nbins=4)  # ticks of a narrow range have many digits
    # Above the axes: bars leave no corner free.
    legend(panels[found.names[0]], loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    return panels


def _units_of(result: FitResult) -> dict[str, str]:
    """The units of force and position, as far as the estimates say them."""
    found = {}
    if "Fc" in result.parameters:
        found["force"] = result.parameters["Fc"].unit
    if "vs" in result.parameters:
        found["position"] = result.parameters["vs"].unit.removesuffix("/s")
    return found


def _stribeck(panel: Axes, result: FitResult, units: Mapping[str, str]) -> None:
    friction = result.drive.friction
    v = _SPEEDS * float(friction.vs)
    forward, backward = (
        np.asarray(jax.vmap(lambda v, sign=sign: result.drive.level(jnp.zeros(()), sign * v))(jnp.asarray(v)))
        + float(friction.sigma2) * v
        for sign in (1.0, -1.0)
    )
    panel.semilogx(v, forward, color=EXTENDED, label="forward")
    spread = _spread(result, v)
    if spread is not None:
        error_band(panel, v, forward, _NORMAL_95 * spread, EXTENDED)
    if not np.allclose(forward, backward):
        panel.semilogx(v, backward, color=EXTENDED, linestyle="dashed", label="backward")
        legend(panel)
    panel.set(
        xlabel=labelled("velocity", per_second(units["position"])),
        ylabel=labelled("friction", units["force"]),
    )
    panel.set_ylim(bottom=0.0)
    panel.set_title("steady sliding, 95 % band", fontsize=8.5)


def _spread(result: FitResult, v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"] | None:
    """Standard error of the friction in steady sliding at `v`, shape `(n,)`; None where one is not known."""
    friction = result.drive.friction
    Fc, Fs, vs = (float(getattr(friction, name)) for name in ("Fc", "Fs", "vs"))
    bell = np.exp(-((v / vs) ** 2))
    slopes = {"Fc": 1.0 - bell, "Fs": bell, "sigma2": v, "vs": (Fs - Fc) * bell * 2.0 * v**2 / vs**3}
    free = [name for name in slopes if name in result.names]
    places = [result.names.index(name) for name in free]
    covariance = result.covariance[np.ix_(places, places)]
    if not free or not np.all(np.isfinite(covariance)):
        return None
    by = np.stack([slopes[name] for name in free])
    return np.sqrt(np.maximum(np.einsum("in,ij,jn->n", by, covariance, by), 0.0))


def _loops(panel: Axes, result: FitResult, units: Mapping[str, str]) -> None:
    friction = result.drive.friction
    deflection = float(friction.Fs / friction.sigma0)
    # So slow that viscous forces are small: a quarter of the largest loop at a hundredth of the Stribeck velocity.
    rate = _QUARTER * 0.01 * float(friction.vs) / deflection
    up = np.linspace(0.0, 1.0, _QUARTER + 1)
    cycle = np.concatenate([up, up[-2::-1], -up[1:], -up[-2::-1]])
    wave = np.concatenate([cycle, *[cycle[1:]] * (_CYCLES - 1)])
    scale, label = engineering(units["position"], deflection)
    for colour, part in zip(COLOURS, _LOOPS, strict=False):
        x = part * deflection * wave
        force = np.asarray(simulate_imposed(result.drive, x, rate).friction)
        steady = slice(-4 * _QUARTER - 1, None)
        panel.plot(scale * x[steady], force[steady], color=colour, linewidth=1.0)
    panel.set(xlabel=labelled("displacement", label), ylabel=labelled("friction", units["force"]))
    panel.set_title("presliding, slow triangles", fontsize=8.5)


def _correlation(panel: Axes, result: FitResult) -> None:
    names, correlation = result.names, result.correlation
    panel.grid(visible=False)
    panel.imshow(correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0)
    panel.set_xticks(range(len(names)), names, rotation=90, fontsize=7)
    panel.set_yticks(range(len(names)), names, fontsize=7)
    for row, column in np.argwhere(np.isfinite(correlation)):
        value = correlation[row, column]
        if row != column and abs(value) >= 0.005:
            dark = abs(value) > 0.6
            text = f"{value:.2f}".replace("0.", ".")
            colour = "white" if dark else MEASURED
            panel.text(column, row, text, ha="center", va="center", fontsize=5.5, color=colour)
    panel.set_title("correlation of the estimates", fontsize=8.5)
