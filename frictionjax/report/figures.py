"""The charts of a recording over time: measured and modelled, and the residual force."""

from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from frictionjax.core.quantities import DisplayUnit
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report.chart import Chart, Panel, Series
from frictionjax.report.format import engineering, quantity
from frictionjax.report.series import limits

_MODELS = ("base", "extended")


@runtime_checkable
class Draw(Protocol):
    """The chart of one interval of a recording.

    `window` selects the samples to draw and `mark` those to tint; the units of `plant` label the axes; `extended`
    says whether there is an extended model to draw.
    """

    def __call__(
        self, recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
    ) -> Chart: ...


def comparison(
    recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
) -> Chart:
    """Measured output and both models, the errors of their 0.1 s predictions, and the input.

    The upper panel has the measured output (dark, on top), the predictions (solid) and the free runs (dashed, the
    user's own simulation among them); in the middle panel, plus and minus twice the noise floor is shaded.

    **Arguments:** as `Draw`; the arrays of `recording` have shape `(n,)`.
    """
    answer, unit, measured = answer_of(recording, plant)
    t, measured = recording.t[window], measured[window]
    models = _MODELS[: 2 if extended else 1]
    predicted = [getattr(recording, f"predicted_{model}")[window] for model in models]
    free = [getattr(recording, f"free_{model}")[window] for model in models]
    # Far from zero the axis counts from the first sample, for short tick labels.
    far = measured.size > 0 and abs(float(np.nanmean(measured))) > 4 * _span(measured)
    origin = float(measured[0]) if far else 0.0
    factor, label = engineering(unit, _span(measured))

    def shifted(series: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return factor * (series - origin)

    upper = [
        Series(f"{model}, free run", model, t, shifted(y), style="dashed")
        for y, model in zip(free, models, strict=True)
    ]
    upper += [
        Series(f"{model}, 0.1 s ahead", model, t, shifted(y), style="thick")
        for y, model in zip(predicted, models, strict=True)
    ]
    if recording.free_given is not None:
        given = shifted(recording.free_given[window])
        upper.append(Series("your simulation, free run", "given", t, given, style="dashed"))
    upper.append(Series("measured", "measured", t, shifted(measured)))
    # A free run may diverge, so the measured motion and the predictions set the limits.
    seen = limits(*(shifted(y) for y in (measured, *predicted)), margin=0.12)
    note = f"counted from {quantity(origin, unit, 6)}" if origin else ""
    panels = [Panel(answer, label, tuple(upper), seen, 130, note)]

    errors = [y - measured for y in predicted]
    factor, label = engineering(unit, max(_size(error) for error in errors))
    wide = np.full(t.size, 2 * factor * recording.noise_floor)
    middle = [Series("noise floor", "band", t, wide, -wide)]
    middle += [
        Series(f"{model}, error", model, t, factor * e) for e, model in zip(errors, models, strict=True)
    ]
    panels.append(Panel("error", label, tuple(middle), limits(*(factor * error for error in errors)), 130))

    cause, unit = ("position", plant.shown_position) if answer == "force" else ("input", plant.shown_input)
    imposed = (recording.x if answer == "force" else recording.u)[window]
    factor, label = engineering(unit, _size(imposed))
    lower = Series(cause, "measured", t, factor * imposed)
    panels.append(Panel(cause, label, (lower,), limits(factor * imposed, margin=0.1), 76))
    return _over_time(tuple(panels), recording, window, mark)


def residual(
    recording: RecordingFit, plant: Plant, extended: bool, window: slice, mark: slice | None = None
) -> Chart:
    """The residual force of the base and of the extended model, over its band of ±2 standard deviations.

    **Arguments:** as `Draw`; the arrays of `recording` have shape `(n,)`.
    """
    t, std = recording.t[window], recording.residual_force_std[window]
    forces = [recording.residual_force[window]]
    if extended:
        forces.append(recording.residual_force_extended[window])
    factor, label = engineering(plant.shown_force, max(_size(force) for force in forces))
    # The band is very wide where nothing moves, so the residuals and the median band set the limits.
    quiet = 2 * float(np.median(std[np.isfinite(std)])) if np.isfinite(std).any() else 0.0
    seen = limits(*(factor * force for force in forces), factor * np.array([-quiet, quiet]))
    series = [Series("± 2 standard deviations", "band", t, 2 * factor * std, -2 * factor * std)]
    series += [
        Series(f"{model} model", model, t, factor * y) for y, model in zip(forces, _MODELS, strict=False)
    ]
    return _over_time((Panel("residual force", label, tuple(series), seen, 130),), recording, window, mark)


def answer_of(
    recording: RecordingFit, plant: Plant
) -> tuple[str, str | DisplayUnit, Float[np.ndarray, " n"]]:
    """The output of the model in this recording: its name, the unit in which it is shown, and its measured values in
    the unit of the case, shape `(n,)`."""
    if recording.drive == "motion" and recording.force is not None:
        return "force", plant.shown_force, recording.force
    return "position", plant.shown_position, recording.x


def _over_time(
    panels: tuple[Panel, ...], recording: RecordingFit, window: slice, mark: slice | None
) -> Chart:
    t = recording.t[window]
    tinted = None
    if mark is not None and mark.stop - mark.start < t.size:
        tinted = float(recording.t[mark.start]), float(recording.t[mark.stop - 1])
    ends = float(t[0]), float(t[-1]) if t.size > 1 else float(t[0]) + 1.0
    return Chart("time", "s", panels, ends, tinted)


def _span(y: Float[np.ndarray, " n"]) -> float:
    finite = y[np.isfinite(y)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _size(y: Float[np.ndarray, " n"]) -> float:
    finite = np.abs(y[np.isfinite(y)])
    return float(finite.max()) if finite.size else 0.0
