"""`plot`: the picture that suits a result."""

import functools
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from frictionjax.arm import ArmDiagnosis
from frictionjax.core import InputError
from frictionjax.core.frames import is_dataset
from frictionjax.diagnosis import Diagnosis
from frictionjax.estimation import Bootstrap, FitResult, Profile
from frictionjax.frequency import FRF
from frictionjax.frequency.sanathanan_koerner import SKResult
from frictionjax.recordings import Case, Recording
from frictionjax.report.canvas import drawing
from frictionjax.report.plots.arm import draw_arm
from frictionjax.report.plots.calibration import draw_calibration
from frictionjax.report.plots.diagnosis import draw_diagnosis
from frictionjax.report.plots.estimates import draw_bootstrap, draw_fit, draw_profile
from frictionjax.report.plots.recordings import draw_case, draw_recording
from frictionjax.report.plots.responses import draw_frf, draw_second_order
from frictionjax.report.plots.sheet import new_figure
from frictionjax.report.plots.signals import draw_trajectory
from frictionjax.report.plots.studies import draw_comparison, draw_levels
from frictionjax.report.plots.study_results import draw_results
from frictionjax.simulation import Trajectory
from frictionjax.studies import Calibration, EstimatorComparison, LevelSweep

_DRAW: dict[type, Callable[..., dict[str, Axes]]] = {
    Trajectory: draw_trajectory,
    FRF: draw_frf,
    SKResult: draw_second_order,
    FitResult: draw_fit,
    Profile: draw_profile,
    Bootstrap: draw_bootstrap,
    Diagnosis: draw_diagnosis,
    ArmDiagnosis: draw_arm,
    Recording: draw_recording,
    Case: draw_case,
    LevelSweep: draw_levels,
    EstimatorComparison: draw_comparison,
    Calibration: draw_calibration,
}


def plot(
    result: Any,
    *,
    axes: Sequence[Axes] | np.ndarray | Axes | None = None,
    units: Mapping[str, str] | None = None,
    over: Sequence[str] | str | None = None,
    names: Sequence[str] | str | None = None,
) -> tuple[Axes, ...]:
    """Draw a result in the way that suits its kind; `result.plot()` is the same.

    | kind | picture |
    |---|---|
    | `Trajectory` | position, velocity and friction force over time |
    | `FRF` | magnitude with its standard deviation, phase, coherence |
    | result of `fit_sk` | measured and fitted response, magnitude and phase |
    | `FitResult` | friction against velocity, presliding loops, correlations of the estimates |
    | `Profile` | deviance, with the parabola of the standard error |
    | `Bootstrap` | the refits of each parameter as a histogram, with the estimate and its interval |
    | `Diagnosis` | held-out prediction errors, residual force, where the mismatch is |
    | `ArmDiagnosis` | torque, what the rigid bodies leave of it, and held-out errors of the friction, by joint |
    | `Recording` | every channel over time |
    | `Case` | position and input of each recording over time, of the first eight |
    | result of `run_study` or `summarise` | each number over one or two dimensions, with its error |
    | result of `level_sweep` | stiffness over the level of the excitation |
    | result of `compare_estimators` | scatter over the Cramer-Rao bound |
    | result of `calibration_of` | rank histograms, reliability of confidences, rate of false names |

    **Arguments:**

    - `result`: one of these.
    - `axes`: matplotlib axes to draw into, one for each panel, so that results can be compared in one figure; None: a
        new figure of pyplot, which a notebook shows.
    - `units`: names for `position`, `force` and `input` (of a `Bootstrap`, for its parameters), where the result has
        none of its own.
    - `over`: of a study, the one or two dimensions to draw over; None: the first ones.
    - `names`: of a study, which results to draw; None: the first twelve.

    **Returns:**

    The matplotlib axes, one a panel; `axes[0].figure.savefig("picture.png")` keeps the picture.

    **Raises:**

    `InputError` for another kind of result, for a batch of results, and for a wrong number of `axes`.
    """
    draw = _DRAW.get(type(result))
    if is_dataset(result):
        draw = functools.partial(draw_results, over=over, names=names)
    elif over is not None or names is not None:
        raise InputError(
            f"a {type(result).__name__} has one picture", place="`over`", cure="Leave `over` and `names` out"
        )
    if draw is None:
        raise InputError(
            f"{type(result).__name__} has no picture",
            place="`result`",
            cure=f"Give one of: {', '.join(kind.__name__ for kind in _DRAW)}.",
        )
    with new_figure() if axes is None else nullcontext(axes) as place, drawing():
        return tuple(draw(result, place, units).values())
