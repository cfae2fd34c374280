"""Every experiment of the paper in one call."""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx

from frictionjax.core import Progress, require_x64, silent
from frictionjax.studies.level_sweep import LevelSweep, level_sweep
from frictionjax.studies.paper.identification import LEVELS, Identified, identify
from frictionjax.studies.paper.linearisation import Linearised, linearised
from frictionjax.studies.paper.presliding import Presliding, presliding
from frictionjax.studies.paper.validation import Validation, validate

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
    - `seconds`: what each part took, s, by its name.
    """

    presliding: Presliding
    linearised: Linearised
    sweep: LevelSweep
    identified: tuple[Identified, ...]
    validations: tuple[Validation, ...]
    seconds: dict[str, float] = eqx.field(static=True)


def reproduce(*, quick: bool = False, seed: int = 0, progress: Progress = silent) -> Paper:
    """Run every experiment of the paper.

    **Arguments:**

    - `quick`: fewer levels, seeds and averages: a look in a tenth of the time, whose numbers are coarser.
    - `seed`: of all noise.
    - `progress`: told how far the work has come.

    **Returns:** the `Paper`.

    **Raises:** `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    seconds: dict[str, float] = {}
    shares = {"presliding": 0.05, "linearised": 0.03, "identified": 0.2, "validations": 0.1, "sweep": 0.62}
    done = 0.0

    def timed(name: str, stage: str, work: Callable[..., Any], **options: Any) -> Any:
        nonlocal done
        start, begun, share = time.perf_counter(), done, shares[name]
        progress(stage, begun)

        def inner(_: str, fraction: float) -> None:
            progress(stage, begun + share * fraction)

        listens = {} if name in ("presliding", "linearised") else {"progress": inner}
        result = work(**options, **listens)
        done += share
        seconds[name] = time.perf_counter() - start
        return result

    slow = timed("presliding", "presliding loop (Fig. 2)", presliding, seconds=20.0 if quick else 80.0)
    linear = timed("linearised", "linearisation (3), (4)", linearised)
    levels, averages = ((0.0025, 0.005, 0.01), 10) if quick else (LEVELS, 50)
    found = timed(
        "identified",
        "responses of the twins (Fig. 4)",
        identify,
        levels=levels,
        averages=averages,
        seed=seed,
    )
    valid = timed("validations", "break-away and sines (Fig. 5, 6)", lambda **o: validate(found, **o))
    small = {"levels": (0.05, 0.1, 0.26), "seeds": 2, "averages": 6}
    sweep = timed(
        "sweep",
        "stiffness against level (Table III)",
        level_sweep,
        seed=seed,
        **(small if quick else {}),
    )
    return Paper(slow, linear, sweep, found, valid, seconds)
