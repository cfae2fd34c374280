"""The figures of the report: one function each, returned as a PNG data URI."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.verdict import RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report import canvas
from frictionjax.report.format import engineering, quantity
from frictionjax.report.series import limits


@runtime_checkable
class Draw(Protocol):
    """A figure of one interval of a recording, as a PNG data URI.

    `window` selects the samples to draw and `mark` those to tint; the units of `plant` label the axes; `extended`
    says whether there is an extended model to draw.
    """

    def __call__(
        self, recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
    ) -> str: ...


def comparison(
    recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
) -> str:
    """Measured output and both models, the errors of their 0.1 s predictions, and the input.

    The upper panel has the measured output (dark, on top), the predictions (solid) and the free runs (dashed);
    in the middle panel, plus and minus twice the noise floor is shaded.

    **Arguments:** as `Draw`; the arrays of `recording` have shape `(n,)`.

    **Returns:**

    A PNG data URI.
    """
    answer, unit, measured = answer_of(recording, plant)
    t, measured = recording.t[window], measured[window]
    predicted = [recording.predicted_base[window]]
    free = [recording.free_base[window]]
    if extended:
        predicted.append(recording.predicted_extended[window])
        free.append(recording.free_extended[window])
    colours = (canvas.BASE, canvas.EXTENDED)
    with canvas.stack((1.5, 1.5, 0.6)) as (figure, (upper, middle, lower)):
        # Far from zero the axis counts from the first sample, for short tick labels.
        origin = float(measured[0]) if abs(float(np.nanmean(measured))) > 4 * _span(measured) else 0.0
        factor, label = engineering(unit, _span(measured))
        for series, colour in zip(free, colours, strict=False):
            canvas.line(upper, t, factor * (series - origin), colour, dashed=True, width=0.9)
        for series, colour in zip(predicted, colours, strict=False):
            canvas.line(upper, t, factor * (series - origin), colour, width=1.8)
        canvas.line(upper, t, factor * (measured - origin), canvas.MEASURED, width=0.8)
        # A free run may diverge, so the measured motion and the predictions set the limits.
        upper.set_ylim(
            limits(*(factor * (series - origin) for series in (measured, *predicted)), margin=0.12)
        )
        upper.set_ylabel(_labelled(answer, label))
        if origin:
            canvas.note(upper, f"counted from {quantity(origin, unit, 6)}")

        errors = [series - measured for series in predicted]
        factor, label = engineering(unit, max(_size(error) for error in errors))
        canvas.band(middle, t, np.full(t.size, 2 * factor * recording.noise_floor))
        for error, colour in zip(errors, colours, strict=False):
            canvas.line(middle, t, factor * error, colour)
        middle.set_ylim(limits(*(factor * error for error in errors)))
        middle.set_ylabel(_labelled("prediction error", label))

        cause, unit = ("position", plant.position_unit) if answer == "force" else ("input", plant.input_unit)
        imposed = (recording.x if answer == "force" else recording.u)[window]
        factor, label = engineering(unit, _size(imposed))
        canvas.line(lower, t, factor * imposed, canvas.MEASURED, width=0.8)
        lower.set_ylim(limits(factor * imposed, margin=0.1))
        lower.set_ylabel(_labelled(cause, label))
        return _finished(figure, recording, window, mark)


def residual(
    recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
) -> str:
    """The residual force of the base and of the extended model, over its band of ±2 standard deviations.

    **Arguments:** as `Draw`; the arrays of `recording` have shape `(n,)`.

    **Returns:**

    A PNG data URI.
    """
    t, std = recording.t[window], recording.residual_force_std[window]
    forces = [recording.residual_force[window]]
    if extended:
        forces.append(recording.residual_force_extended[window])
    with canvas.stack((1.5,)) as (figure, (axes,)):
        factor, label = engineering(plant.force_unit, max(_size(force) for force in forces))
        canvas.band(axes, t, 2 * factor * std)
        for force, colour in zip(forces, (canvas.BASE, canvas.EXTENDED), strict=False):
            canvas.line(axes, t, factor * force, colour)
        # The band is very wide where nothing moves, so the residuals and the median band set the limits.
        quiet = 2 * float(np.median(std[np.isfinite(std)])) if np.isfinite(std).any() else 0.0
        axes.set_ylim(limits(*(factor * force for force in forces), factor * np.array([-quiet, quiet])))
        axes.set_ylabel(_labelled("residual force", label))
        return _finished(figure, recording, window, mark)


def answer_of(recording: RecordingFit, plant: Plant) -> tuple[str, str, Float[np.ndarray, " n"]]:
    """The output of the model in this recording: its name, its unit, and its measured values, shape `(n,)`."""
    if recording.drive == "motion" and recording.force is not None:
        return "force", plant.force_unit, recording.force
    return "position", plant.position_unit, recording.x


def _finished(figure: canvas.Figure, recording: RecordingFit, window: slice, mark: slice | None) -> str:
    t = recording.t[window]
    if mark is not None and mark.stop - mark.start < t.size:
        canvas.mark(figure.axes, float(recording.t[mark.start]), float(recording.t[mark.stop - 1]))
    figure.axes[0].set_xlim(float(t[0]), float(t[-1]) if t.size > 1 else float(t[0]) + 1.0)
    return canvas.png(figure)


def _labelled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name


def _span(y: Float[np.ndarray, " n"]) -> float:
    finite = y[np.isfinite(y)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _size(y: Float[np.ndarray, " n"]) -> float:
    finite = np.abs(y[np.isfinite(y)])
    return float(finite.max()) if finite.size else 0.0
