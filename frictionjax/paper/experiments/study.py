"""Every experiment of the paper in one call."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any

import equinox as eqx

from frictionjax.core import Progress, require_x64, silent
from frictionjax.paper.experiments.identification import LEVELS, Identified, identify
from frictionjax.paper.experiments.linearisation import Linearised, linearised
from frictionjax.paper.experiments.presliding import Presliding, presliding
from frictionjax.paper.experiments.validation import Validation, validate
from frictionjax.studies.estimator_comparison import EstimatorComparison, compare_estimators
from frictionjax.studies.level_sweep import LevelSweep, level_sweep

REFERENCE_A5 = (
    (0.02, 9.93e4, 9.93e4),
    (0.10, 9.48e4, 9.51e4),
    (0.20, 8.47e4, 8.69e4),
    (0.26, 7.77e4, 7.88e4),
    (0.35, 6.24e4, 6.75e4),
    (0.45, 4.62e4, 5.25e4),
    (0.55, 3.25e4, 3.89e4),
)
"""Level (rms over Fs) and fitted stiffness (N/m) of the plant of Table I with PRBS and Gaussian noise, from a program
that shares no code with this one. Levels 0.02, 0.10 and 0.26 are means of three runs, the others one run."""


class Paper(eqx.Module):
    """The paper's experiments.

    **Attributes:**

    - `presliding`: Fig. 2.
    - `linearised`: equations (3) and (4).
    - `sweep`: Fig. 4(a) and Table III on the plant of Table I.
    - `identified`: Fig. 4 on each twin.
    - `validations`: Fig. 5 and 6 on each twin.
    - `seconds`: what each part took, s, by its name; the parts share the machine with the comparison.
    - `comparison`: of the estimators, if it was made.
    """

    presliding: Presliding
    linearised: Linearised
    sweep: LevelSweep
    identified: tuple[Identified, ...]
    validations: tuple[Validation, ...]
    seconds: dict[str, float] = eqx.field(static=True)
    comparison: EstimatorComparison | None


def reproduce(
    *, quick: bool = False, draws: int | None = None, seed: int = 0, progress: Progress = silent
) -> Paper:
    """Run every experiment of the paper, and beside them the comparison of estimators.

    **Arguments:**

    - `quick`: fewer levels, seeds, averages and draws: a fraction of the time, less accurate numbers.
    - `draws`: of the comparison at each of its noise levels; 0 leaves it out. By default 500, or 0 if `quick`.
    - `seed`: of all noise.
    - `progress`: called as the work goes on.

    **Returns:** the `Paper`.

    **Raises:** `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    draws = (0 if quick else 500) if draws is None else draws
    compared = _Reached()
    # Two threads draw while this one runs the experiments, each of which is one long scan.
    with ThreadPoolExecutor(1) as beside, ThreadPoolExecutor(2) as drawers:
        comparing = (
            beside.submit(compare_estimators, draws=draws, seed=seed, executor=drawers, progress=compared)
            if draws
            else None
        )
        try:
            paper = _experiments(quick, seed, progress, 0.6 if draws else 1.0)
            if comparing is None:
                return paper
            while not comparing.done():
                progress("comparing estimators", 0.6 + 0.4 * compared.fraction)
                wait([comparing], timeout=1.0)
            comparison = comparing.result()
        except BaseException:
            drawers.shutdown(wait=False, cancel_futures=True)
            raise
    progress("estimators compared", 1.0)
    return replace(paper, comparison=comparison)


class _Reached:
    """Progress of the work in another thread, passed on to the terminal by this thread."""

    def __init__(self) -> None:
        self.fraction = 0.0

    def __call__(self, stage: str, fraction: float) -> None:
        self.fraction = max(self.fraction, fraction)


def _experiments(quick: bool, seed: int, progress: Progress, part: float) -> Paper:
    """The paper's own experiments, one after the other; they take the progress from 0 to `part`."""
    seconds: dict[str, float] = {}

    def timed(name: str, what: str, start: float, stop: float, work: Callable[[Progress], Any]) -> Any:
        def inner(stage: str, fraction: float) -> None:
            progress(what, part * (start + (stop - start) * fraction))

        inner(what, 0.0)
        started = time.perf_counter()
        result = work(inner)
        seconds[name] = time.perf_counter() - started
        inner(what, 1.0)
        return result

    loop_seconds = 20.0 if quick else 80.0
    levels, averages = ((0.0025, 0.005, 0.01), 10) if quick else (LEVELS, 50)
    fewer: dict[str, Any] = {"levels": (0.05, 0.1, 0.26), "seeds": 2, "averages": 6} if quick else {}
    slow = timed("fig2", "presliding loop (Fig. 2)", 0.0, 0.05, lambda _: presliding(seconds=loop_seconds))
    linear = timed("linearisation", "linearisation (3), (4)", 0.05, 0.08, lambda _: linearised())
    found = timed(
        "fig4",
        "responses of the twins (Fig. 4)",
        0.08,
        0.3,
        lambda report: identify(levels=levels, averages=averages, seed=seed, progress=report),
    )
    valid = timed(
        "fig5_fig6",
        "break-away and sines (Fig. 5, 6)",
        0.3,
        0.4,
        lambda report: validate(found, progress=report),
    )
    sweep = timed(
        "table3",
        "stiffness against level (Table III)",
        0.4,
        1.0,
        lambda report: level_sweep(seed=seed, progress=report, **fewer),
    )
    return Paper(slow, linear, sweep, found, valid, seconds, None)
