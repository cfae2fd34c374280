"""Frequency responses: what was measured, and the second-order system that fits it."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.axes import Axes

from frictionjax.core import InputError
from frictionjax.frequency import FRF
from frictionjax.frequency.sanathanan_koerner import SKResult
from frictionjax.report.canvas import BAND, EXTENDED, MEASURED
from frictionjax.report.plots.sheet import Place, labelled, legend, new_axes, units_of

_LEAST = 1e-6  # of the largest magnitude: what lies below it is rounding


def draw_frf(frf: FRF, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Magnitude with twice its standard deviation, phase and coherence of `frf`; `place` as in `new_axes`,
    `units` as in `plot`."""
    frequency = np.asarray(frf.frequency)
    if frequency.ndim != 1:
        raise InputError(
            f"the FRF is a batch of shape {frequency.shape[:-1]}",
            place="`result`",
            cure="Draw one of it: `jax.tree.map(lambda leaf: leaf[i], frf).plot()`.",
        )
    panels = new_axes([["magnitude"], ["phase"], ["coherence"]], place, ("magnitude", "phase", "coherence"))
    response, std = np.asarray(frf.response), np.asarray(frf.std)
    shown = (frequency > 0.0) & np.isfinite(std) & (np.abs(response) > 0.0)
    _measured(panels, frequency[shown], response[shown], std[shown])
    _labels(panels, units)
    panels["coherence"].semilogx(
        frequency[shown], np.asarray(frf.coherence)[shown], color=MEASURED, linewidth=0.9
    )
    panels["coherence"].set(ylim=(0.0, 1.05), ylabel="coherence", xlabel="frequency (Hz)")
    return panels


def draw_second_order(found: SKResult, place: Place, units: Mapping[str, str] | None) -> dict[str, Axes]:
    """Measured and fitted response of `found`, magnitude and phase; `place` as in `new_axes`, `units` as in `plot`."""
    panels = new_axes([["magnitude"], ["phase"]], place, ("magnitude", "phase"))
    _measured(panels, found.frequency, found.measured, found.std)
    panels["magnitude"].loglog(found.frequency, np.abs(found.response), color=EXTENDED, label="second order")
    panels["phase"].semilogx(found.frequency, _degrees(found.response), color=EXTENDED)
    known = found.natural_frequency
    if known.identified:
        for panel in panels.values():
            panel.axvline(known.value, color=BAND, linewidth=0.8, linestyle="dotted")
        panels["magnitude"].set_title(f"{known.value:.4g} ± {known.stderr:.2g} Hz", fontsize=8.5)
    _labels(panels, units)
    panels["phase"].set_xlabel("frequency (Hz)")
    legend(panels["magnitude"])
    return panels


def _measured(
    panels: dict[str, Axes],
    frequency: Float[np.ndarray, " n"],
    response: Complex[np.ndarray, " n"],
    std: Float[np.ndarray, " n"],
) -> None:
    size = np.abs(response)
    low = np.maximum(size - 2.0 * std, _LEAST * size.max(initial=0.0))
    magnitude = panels["magnitude"]
    magnitude.fill_between(frequency, low, size + 2.0 * std, color=BAND, alpha=0.4, linewidth=0)
    magnitude.loglog(
        frequency, size, color=MEASURED, linewidth=0.9, label="measured, ± 2 standard deviations"
    )
    panels["phase"].semilogx(frequency, _degrees(response), color=MEASURED, linewidth=0.9)


def _degrees(response: Complex[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return np.degrees(np.unwrap(np.angle(response)))


def _labels(panels: dict[str, Axes], units: Mapping[str, str] | None) -> None:
    known = units_of(units)
    panels["magnitude"].set_ylabel(labelled("magnitude", f"{known['position']}/{known['input']}"))
    panels["phase"].set_ylabel("phase (degrees)")
