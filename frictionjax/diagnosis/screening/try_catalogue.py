"""Every effect of the catalogue tested beside a fitted model."""

import dataclasses
from concurrent.futures import Executor
from typing import Any

import numpy as np

from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.pace import search_bandwidth
from frictionjax.diagnosis.screening.linearised import Present, present_model
from frictionjax.diagnosis.screening.periods import Wavelengths, wavelengths
from frictionjax.diagnosis.screening.resonance import Pair
from frictionjax.diagnosis.screening.score_test import (
    Trial,
    forms_to_try,
    lots,
    promises_of,
    simulated,
    worth_simulating,
)
from frictionjax.estimation.descent.robust import level_out
from frictionjax.physics.effects import AbstractEffect, AbstractLoadEffect, catalogue

_TO_A_TASK = (
    4  # forms that are tested one after the other: each fills half a program, and two of them go together
)


def try_catalogue(
    model: Model,
    scales: dict[str, float],
    executor: Executor,
    without: frozenset[str],
    pair: Pair | None = None,
    *,
    effort: Effort = Effort(),
) -> list[list[Trial]]:
    """Every form of every effect of the catalogue, except those in the model and those named in `without` (effects or
    forms), at every point of its grid; second inertias at the antiresonance of the `pair`, too.

    **Returns:** the trials of the model as it is, and, where it is far from the noise, those of the model where it
    misses all regimes alike (`level_out`).
    """
    presents = _presents(model, executor, effort)
    present, batch = presents[0], presents[0].posterior.batch
    speed = np.gradient(np.asarray(batch.x), axis=1) / np.asarray(batch.dt)[:, None]
    e = np.nan_to_num(np.asarray(present.e))
    waves = {
        "odd_period": wavelengths(e, speed, batch, odd=True, effort=effort),
        "even_period": wavelengths(e, speed, batch, odd=False, effort=effort),
        "sensor_period": wavelengths(e, speed, batch, odd=False, count=2, fine=True, effort=effort),
    }
    inside = model.posterior.drive.effects
    forms = [form for name, all_forms in catalogue().items() if name not in without for form in all_forms]
    forms = [form for form in forms if form.__name__ not in without]
    if any(isinstance(effect, AbstractLoadEffect) for effect in inside):
        forms = [form for form in forms if not issubclass(form, AbstractLoadEffect)]
    # Another form of an effect that is named already is a matter of its form, not another effect.
    forms = [form for form in forms if form.name not in {effect.name for effect in inside}]

    def instances(form: type[AbstractEffect]) -> list[AbstractEffect]:
        grid = forms_to_try(form, scales, {kind: found.periods for kind, found in waves.items()})
        if pair is not None and issubclass(form, AbstractLoadEffect):
            at_pair: dict[str, Any] = {"frequency": pair.frequency}  # a field of each of these forms
            grid.append(dataclasses.replace(grid[0], **at_pair))
        return grid

    # All of them are queued before one is waited for: no core idles between the models.
    grids = lots([instances(form) for form in forms], _TO_A_TASK)
    promising = [
        executor.map(lambda some, seen=seen: promises_of(seen, some, scales), grids) for seen in presents
    ]
    simulating = []
    for seen, promises in zip(presents, promising, strict=True):
        promised = [one for some in promises for one in some]
        least = worth_simulating(promised, effort=effort)
        simulating.append(
            executor.map(
                lambda some, seen=seen, least=least: simulated(seen, some, least), lots(promised, _TO_A_TASK)
            )
        )
    return [
        [_as_chosen(trial, waves) for some in trials for own in some for trial in own]
        for trials in simulating
    ]


def _as_chosen(trial: Trial, waves: dict[str, Wavelengths]) -> Trial:
    """The `trial` of one of the strongest periods, tested as one of all those that it was chosen from."""
    chosen = [waves[str(nuisance.scale)] for nuisance in trial.form.nuisances if nuisance.grid == "period"]
    times = max((found.among / max(len(found.periods), 1) for found in chosen), default=1.0)
    return dataclasses.replace(trial, p_value=min(1.0, trial.p_value * times)) if times > 1.0 else trial


def _presents(model: Model, executor: Executor, effort: Effort) -> list[Present]:
    """The model as it is; and, where it is far from the noise, also where it misses all regimes alike."""
    posterior, vector = model.posterior, model.fitted.vector
    searched = posterior.at_bandwidth(search_bandwidth(posterior, vector))
    present = executor.submit(present_model, searched, vector)
    if searched.batch.imposed or searched.misfits([vector])[0] < effort.screening.level:
        return [present.result()]
    level = level_out(searched, vector)
    return [present.result(), present_model(searched, level)]
