"""Warm: compile what diagnoses of force-driven machines need, so that later ones load it.

A program is made for the structure of a model, not for a case (`core/programs.py`): the base model, and the base model
with each form of each effect. Two effects at once are compiled when they are met; so are an imposed motion, a known
inertia, the Kalman filter of a coarse sensor and the user's own model.
"""

import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import equinox as eqx
import numpy as np

from frictionjax.core import InputError, Progress, reporting, require_x64
from frictionjax.core.setup import programs_folder
from frictionjax.diagnosis.base_model.fit_base import parameters_of
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.evidence.views import view
from frictionjax.diagnosis.intake.as_asked import check_effects
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import forms_to_try, try_form
from frictionjax.estimation.data.batch import Batch, make_batch
from frictionjax.estimation.data.pieces import SHORTEST, lengths_up_to
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects import AbstractEffect, catalogue
from frictionjax.recordings import Recording

_RATE, _SAMPLES, _RECORDINGS = 500.0, 400, 3
_PERIODS = ("odd_period", "even_period", "sensor_period")


class Warmed(eqx.Module):
    """What `warm` did.

    **Attributes:** `structures` (models whose programs are there), `programs` (kept in the `folder`, those that were
    there before included), `megabytes` (their size), `seconds` (that it took).
    """

    structures: int = eqx.field(static=True)
    programs: int = eqx.field(static=True)
    megabytes: float = eqx.field(static=True)
    seconds: float = eqx.field(static=True)
    folder: Path = eqx.field(static=True)


def warm(
    effects: Sequence[str] | None = None, *, longest: int = SHORTEST, progress: Progress | bool = True
) -> Warmed:
    """Compile, and keep, the programs with which force-driven recordings are diagnosed.

    **Arguments:**

    - `effects`: names from the catalogue; None: all of it.
    - `longest`: samples of the longest recording that programs are made for: there are those for recordings of up to
        16,384 samples, up to four times that, and so on.
    - `progress`: called with the stage and the fraction done; True: a bar on a terminal and in a notebook; False:
        nothing.

    **Returns:**

    A `Warmed`.

    **Raises:**

    `InputError` where JAX keeps no programs on disk (`configure_jax()` makes it), and for an effect that is not in the
    catalogue; `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    started, folder = time.perf_counter(), programs_folder()
    if folder is None:
        raise InputError(
            "no folder for compiled programs is set, or it is not yours",
            cure="call configure_jax() first, without compilation_cache=False",
        )
    known = catalogue()
    names = list(known) if effects is None else list(effects)
    check_effects(names)
    forms: list[type[AbstractEffect] | None] = [None, *(form for name in names for form in known[name])]
    work = [(form, length) for length in lengths_up_to(longest) for form in forms]
    with reporting(progress) as report, ThreadPoolExecutor(os.cpu_count() or 1) as threads:
        running = [threads.submit(_compiled_for, *one) for one in work]
        for number, (one, (form, length)) in enumerate(zip(running, work, strict=True)):
            name = "the base model" if form is None else form.__name__
            report(f"{name}, recordings of up to {length} samples", number / len(work))
            one.result()
    files = [file for file in folder.rglob("*") if file.is_file()]
    size = 1e-6 * sum(file.stat().st_size for file in files)
    return Warmed(len(work), len(files), size, time.perf_counter() - started, folder)


def _recordings(length: int) -> Batch:
    """Recordings that are padded to the `length`: what they hold does not matter."""
    samples = _SAMPLES if length == SHORTEST else length // 4 + 1
    t = np.arange(samples) / _RATE
    found = []
    for number in range(_RECORDINGS):
        phase = 2.0 * np.pi * (1.0 + 0.2 * number) * t
        rng = np.random.default_rng(number)
        x = 0.1 * np.sin(phase) + 1e-6 * rng.standard_normal(samples)
        found.append(Recording(f"recording {number}", _RATE, 0.2 * np.cos(phase), x))
    return make_batch(tuple(found))


def _compiled_for(form: type[AbstractEffect] | None, length: int) -> None:
    """Take the steps of a diagnosis once with the structure of the base model and a `form` of an effect."""
    batch = _recordings(length)
    held_out = np.arange(_RECORDINGS) == _RECORDINGS - 1
    drive = Drive(J=0.01, friction=LuGre(100.0, 1.0, 0.05, 0.1, 0.15, 0.02))
    scales = plant_scales(drive, batch)
    base, start = robust_posterior(drive, batch, held_out, scales=scales)
    posterior, vector = base, start
    instances = [] if form is None else forms_to_try(form, scales, dict.fromkeys(_PERIODS, (0.05,)))
    if instances:
        try_form(present_model(base, start), instances[:1], scales, effort=Effort())
        posterior, vector = extend(base, start, instances[0], scales)
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    fitted = descend(slow, vector, graduate=False, steps=1)
    model = Model(slow, fitted, judge(slow, fitted))
    answer_to_force(slow, fitted.vector, rule=Rule())
    present = present_model(slow, fitted.vector)
    present.with_forces(np.asarray(present.vector)[None], np.zeros((1, *batch.x.shape))[:, ~held_out])
    view(model.judgement, scene_of(model, tuple(f"recording {number}" for number in range(_RECORDINGS))))
    for lacking in (True, False):
        parameters_of(model, {}, lacking=lacking)
