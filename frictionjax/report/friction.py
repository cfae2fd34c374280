"""The field's own pictures: friction over velocity and displacement, the residual force where an effect acts."""

import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.physics.effects import catalogue
from frictionjax.recordings.words import shown
from frictionjax.report.chart import Chart, Panel, Series
from frictionjax.report.format import engineering
from frictionjax.report.motion import PlottedMotion, bristle_bend
from frictionjax.report.series import limits

_BINS = 28
_LEAST = 12  # samples of a bin that is drawn
_LOOP = 20.0  # deflections at break-away: a longer loop slides
_MODELS = (("measured", "measured"), ("base", "base model"), ("extended", "extended model"))


class Variable(NamedTuple):
    """What the residual force is drawn over.

    **Attributes:** `label`, `unit` (with `{position}` and `{input}` for those of the case), its `values` for one
    `PlottedMotion` (NaN where it has none), `opposing` (whether the force is counted against the motion, as friction
    is), `logarithmic` (whether the axis shows decades).
    """

    label: str
    unit: str
    values: Callable[[PlottedMotion], Float[np.ndarray, " n"]]
    opposing: bool = False
    logarithmic: bool = False


def _finite(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return np.where(np.isfinite(values) & (values > 0.0), values, np.nan)


VARIABLES = {
    "velocity": Variable("velocity", "{position}/s", lambda one: one.v),
    "position": Variable("position", "{position}", lambda one: one.x),
    "since_reversal": Variable(
        "travel since the last reversal", "{position}", lambda one: _finite(one.travel), True, True
    ),
    "dwell": Variable(
        "length of the last rest",
        "s",
        lambda one: np.where(one.rests, np.nan, _finite(one.rest)),
        True,
        True,
    ),
    "input": Variable("input", "{input}", lambda one: one.u),
    "input_rate": Variable("rate of the input", "{input}/s", lambda one: np.gradient(one.u, one.t)),
    "time": Variable("time", "s", lambda one: one.t, True),
}
"""By the names that effects have for where they show (`AbstractEffect.along`); "frequency" is a spectrum."""


def over_velocity(diagnosis: Diagnosis, motions: Sequence[PlottedMotion], extended: bool) -> Chart | None:
    """Friction in sliding over the speed, each direction in a panel: medians of measured, base and extended model.

    **Arguments:** `diagnosis`, its `motions`, and whether there is an `extended` model.

    **Returns:** the chart; None where nothing slides.
    """
    speed = np.concatenate([np.abs(one.v[one.slides]) for one in motions] or [np.zeros(0)])
    if speed.size < _LEAST * 4:
        return None
    low, high = np.quantile(speed, (0.002, 0.998)).tolist()
    if not 0.0 < low < high:
        return None
    factor, label = engineering(diagnosis.plant.shown_position, high)
    edges = np.geomspace(low, high, _BINS + 1)
    panels = []
    found = {}
    for sign in (1.0, -1.0):
        for name, _ in _MODELS[: 3 if extended else 2]:
            v = np.concatenate([one.v[one.slides] for one in motions])
            force = np.concatenate([getattr(one, name)[one.slides] for one in motions])
            mine = np.sign(v) == sign
            found[sign, name] = _medians(np.abs(v[mine]), sign * force[mine], edges)
    size = max((float(np.nanmax(np.abs(y))) for _, y in found.values() if np.isfinite(y).any()), default=0.0)
    times, unit = engineering(diagnosis.plant.shown_force, size)
    for sign, direction in ((1.0, "forward"), (-1.0, "backward")):
        series = tuple(
            Series(
                words_of,
                name,
                factor * found[sign, name][0],
                times * found[sign, name][1],
                style="dots" if name == "measured" else "thick" if name == "base" else "line",
            )
            for name, words_of in (*_MODELS[1 : 3 if extended else 2], _MODELS[0])
        )
        if any(np.isfinite(one.y).any() for one in series):
            panels.append(Panel("friction", unit, series, limits(*(one.y for one in series)), note=direction))
    if not panels:
        return None
    return Chart("speed", f"{label}/s", tuple(panels), (factor * low, factor * high), logarithmic=True)


def over_displacement(diagnosis: Diagnosis, motions: Sequence[PlottedMotion], extended: bool) -> Chart | None:
    """Friction over displacement along the presliding loops that the extended model improves most.

    **Arguments:** `diagnosis`, its `motions`, and whether there is an `extended` model.

    **Returns:** the chart; None where no recording turns back twice within presliding.
    """
    reach = _LOOP * bristle_bend(diagnosis.base)
    best, chosen = -1.0, None
    for one in motions:
        turns = _turns(one)
        for first in range(len(turns) - 2):
            part = slice(int(turns[first]), int(turns[first + 2]))
            if part.stop - part.start < _LEAST or not np.ptp(one.x[part]) < reach:
                continue
            gain = np.square(one.lacks_base[part])
            if extended:
                gain = gain - np.square(one.lacks_extended[part])
            total = float(np.nansum(gain)) * float(np.ptp(one.x[part]))
            if total > best:
                best, chosen = total, (one, turns, first)
    if chosen is None:
        return None
    one, turns, first = chosen
    begin, end = max(first - 1, 0), min(first + 3, len(turns) - 1)
    while begin < first and not np.ptp(one.x[turns[begin] : turns[end]]) < reach:
        begin += 1
    while end > first + 2 and not np.ptp(one.x[turns[begin] : turns[end]]) < reach:
        end -= 1
    part = slice(int(turns[begin]), int(turns[end]) + 1)
    middle = float(np.mean(one.x[part]))
    factor, label = engineering(diagnosis.plant.shown_position, float(np.ptp(one.x[part])))
    times, unit = engineering(diagnosis.plant.shown_force, float(np.max(np.abs(one.measured[part]))))
    step = max(1, (part.stop - part.start) // 1500)
    series = tuple(
        Series(
            words_of,
            name,
            factor * (one.x[part][::step] - middle),
            times * getattr(one, name)[part][::step],
            style="thick" if name == "base" else "line",
        )
        for name, words_of in (*_MODELS[1 : 3 if extended else 2], _MODELS[0])
    )
    note = f"{shown(one.name, 24)}, {one.t[part.start]:.3g} to {one.t[part.stop - 1]:.3g} s"
    panel = Panel("friction", unit, series, limits(*(s.y for s in series)), 274, note)
    return Chart("displacement", label, (panel,), limits(*(s.x for s in series)), path=True)


def where_it_acts(
    effect: str, diagnosis: Diagnosis, motions: Sequence[PlottedMotion], extended: bool
) -> Chart | None:
    """The residual force over the variable along which an effect shows, in bins.

    **Arguments:** `effect` of the catalogue; the `diagnosis`, its `motions`, and whether there is an `extended` model.

    **Returns:** the chart; None where the recordings do not show it, or the effect is not in the catalogue.
    """
    forms = catalogue().get(effect)
    along = forms[0].along if forms else None
    if along is None or not motions:
        return None
    if along == "frequency":
        return _spectrum(diagnosis, motions, extended)
    variable = VARIABLES[along]
    if along == "time":
        motions = [max(motions, key=lambda one: float(one.t[-1]))]
    values = np.concatenate([variable.values(one) for one in motions])
    direction = np.concatenate([one.direction for one in motions])
    label = variable.label
    if along == "position" and (period := _period(effect, diagnosis)):
        values, label = np.mod(values, period), "position within one period"
    if along == "position" or variable.opposing:
        values = np.where(direction == 0.0, np.nan, values)
    weight = -direction if variable.opposing else np.ones_like(direction)
    inside = np.isfinite(values)
    if np.count_nonzero(inside) < _LEAST * 4:
        return None
    low, high = np.quantile(values[inside], (0.002, 0.998)).tolist()
    if not low < high or (variable.logarithmic and not low > 0.0):
        return None
    count = _BINS * 2 if along == "position" else _BINS
    edges = np.geomspace(low, high, count + 1) if variable.logarithmic else np.linspace(low, high, count + 1)
    models = (("base", "lacks_base"), ("extended", "lacks_extended"))[: 2 if extended else 1]
    apart = (1.0, -1.0) if along == "position" else (0.0,)
    lines = []
    for sign in apart:
        mine = inside & ((direction == sign) if sign else True)
        for colour, name in models:
            force = np.concatenate([getattr(one, name) for one in motions])
            lines.append((sign, colour, *_medians(values[mine], (weight * force)[mine], edges)))
    return _binned(label, variable, lines, (low, high), diagnosis)


def _binned(
    label: str,
    variable: Variable,
    lines: list[tuple[float, str, Float[np.ndarray, " m"], Float[np.ndarray, " m"]]],
    ends: tuple[float, float],
    diagnosis: Diagnosis,
) -> Chart | None:
    plant = diagnosis.plant
    head, _, tail = variable.unit.partition("/")
    base = head.format(position=plant.position_unit, input=plant.input_unit)
    factor, unit = engineering(plant.displayed(base), max(abs(end) for end in ends))
    unit = f"{unit}/{tail}" if tail else unit
    size = max((float(np.nanmax(np.abs(y))) for *_, y in lines if np.isfinite(y).any()), default=0.0)
    if size == 0.0:
        return None
    times, force_unit = engineering(plant.shown_force, size)
    name = "friction lacking" if variable.opposing else "residual force"
    panels = []
    for sign in dict.fromkeys(line[0] for line in lines):
        series = tuple(
            Series(
                f"{colour} model",
                colour,
                factor * x,
                times * y,
                style="thick" if colour == "base" else "line",
            )
            for its, colour, x, y in lines
            if its == sign
        )
        note = {1.0: "forward", -1.0: "backward"}.get(sign, "")
        zero = np.zeros(1)
        panels.append(Panel(name, force_unit, series, limits(*(s.y for s in series), zero), 130, note))
    if len(panels) == 1:
        (only,) = panels
        panels = [Panel(only.name, only.unit, only.series, only.limits, 274)]
    ends = (factor * ends[0], factor * ends[1])
    return Chart(label, unit, tuple(panels), ends, logarithmic=variable.logarithmic)


def _spectrum(diagnosis: Diagnosis, motions: Sequence[PlottedMotion], extended: bool) -> Chart | None:
    """Amplitude density of the residual force, of the recording that the extended model improves most."""

    def drop(one: PlottedMotion) -> float:
        after = float(np.nanmean(np.square(one.lacks_extended))) if extended else 0.0
        return float(np.nanmean(np.square(one.lacks_base))) - after

    one = max(motions, key=drop)
    n = one.t.size
    window = np.hanning(n)
    names = (("base", "lacks_base"), ("extended", "lacks_extended"))[: 2 if extended else 1]
    frequency = np.fft.rfftfreq(n, one.dt)
    edges = np.geomspace(max(frequency[1], 0.2), frequency[-1], 120)
    found = []
    for colour, name in names:
        force = np.nan_to_num(getattr(one, name))
        power = np.square(np.abs(np.fft.rfft(window * (force - force.mean()))))
        density = np.sqrt(2.0 * power * one.dt / float(np.sum(np.square(window))))
        found.append((colour, *_medians(frequency, density, edges, least=1)))
    size = max((float(np.nanmax(y)) for *_, y in found if np.isfinite(y).any()), default=0.0)
    if size == 0.0:
        return None
    times, unit = engineering(diagnosis.plant.shown_force, size)
    series = tuple(
        Series(f"{colour} model", colour, x, times * y, style="thick" if colour == "base" else "line")
        for colour, x, y in found
    )
    panel = Panel(
        "residual force", f"{unit}/√Hz", series, limits(*(s.y for s in series)), 274, shown(one.name, 24)
    )
    return Chart("frequency", "Hz", (panel,), (float(edges[0]), float(edges[-1])), logarithmic=True)


def _period(effect: str, diagnosis: Diagnosis) -> float:
    """The period of a named wave, position units; 0 for anything else."""
    for found in diagnosis.missing:
        if found.effect == effect and "period" in found.parameters:
            period = found.parameters["period"].value
            return period if math.isfinite(period) and period > 0.0 else 0.0
    return 0.0


def _medians(
    x: Float[np.ndarray, " n"],
    y: Float[np.ndarray, " n"],
    edges: Float[np.ndarray, " b"],
    *,
    least: int = _LEAST,
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Medians of both in every bin of `x`; NaN in those with fewer samples than `least`."""
    kept = np.isfinite(x) & np.isfinite(y) & (x >= edges[0]) & (x <= edges[-1])
    x, y = x[kept], y[kept]
    place = np.minimum(np.searchsorted(edges, x, side="right") - 1, edges.size - 2)
    order = np.argsort(place, kind="stable")
    starts = np.searchsorted(place[order], np.arange(edges.size))
    middle = np.full((2, edges.size - 1), np.nan)
    for k, (begin, end) in enumerate(itertools.pairwise(starts.tolist())):
        if end - begin >= least:
            mine = order[begin:end]
            middle[:, k] = np.median(x[mine]), np.median(y[mine])
    return middle[0], middle[1]


def _turns(one: PlottedMotion) -> Int[np.ndarray, " k"]:
    """Samples at which the motion reverses."""
    return np.flatnonzero(one.travel[1:] < one.travel[:-1]) + 1
