"""The user's own simulation as it was given, nothing fitted: how far it is from the recordings, and where it misses.

It is a column `simulated` of the recordings, or the user's own model with the values that the case gives. Both are
compared as free runs: a column has no observer. The map is that of the base model with other errors: those of an
observer that has the acceleration from the simulation, and position and velocity from the measurement.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Literal

import numpy as np
from jaxtyping import Float

from frictionjax.core.quantities import in_unit
from frictionjax.diagnosis.evidence.judgement import Judgement, Scene
from frictionjax.diagnosis.evidence.views import GivenPredictions, View, view
from frictionjax.diagnosis.intake.starting_point import StartingPoint
from frictionjax.diagnosis.mismatch_map.locate import Located, grid_along
from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.verdict import SimulationAsGiven
from frictionjax.estimation.data.batch import rows_of
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect
from frictionjax.recordings import Plant, Recording
from frictionjax.simulation import innovation_gain, left_by_observer, observer_gains

BOTH = (
    "The recordings have a column `simulated`: that is compared as the simulation as given, not the model of the case "
    "with its given values."
)

_FAR = 1e100  # position or force units: sums of squares below it stay finite

ModelName = Literal["base", "extended", "given"]


def as_given(
    starting: StartingPoint, scene: Scene, silent_effects: tuple[AbstractEffect, ...] = ()
) -> GivenPredictions | None:
    """What the user's own simulation predicts for the recordings of the `scene`; None where there is none.

    **Arguments:**

    - `starting`: with the recordings and their columns `simulated`, which count first, and with the user's own model.
    - `scene`: all recordings.
    - `silent_effects`: what the extended model has beyond the user's own, at zero strength, so that both share one
      program.
    """
    column = column_as_given(starting.recordings, scene)
    if column is not None or not starting.own.complete:
        return column
    drive = drive_as_given(starting, silent_effects)
    held_out, batch = scene.held_out, scene.batch
    power = np.ones(np.asarray(batch.block_count).shape)
    found = view(Judgement(drive, np.zeros(held_out.size), power, held_out, batch), scene)
    return GivenPredictions("model", np.ones(held_out.size, bool), found.free, found.ahead)


def drive_as_given(starting: StartingPoint, silent_effects: tuple[AbstractEffect, ...]) -> Drive:
    """The user's own model with the values that the case gives, with the `silent_effects` as in `as_given`."""
    return starting.own.applied(starting.start.drives[0]).with_effects(*silent_effects)


def column_as_given(recordings: tuple[Recording, ...], scene: Scene) -> GivenPredictions | None:
    """The columns `simulated` of the `recordings` of the `scene`; None where none of them has one."""
    there = np.array([recording.simulated is not None for recording in recordings])
    if not there.any():
        return None
    free = np.zeros(np.asarray(scene.batch.x).shape)
    for row, recording in enumerate(recordings):
        if recording.simulated is not None:
            free[row, : recording.x.size] = recording.simulated
    return GivenPredictions("column", there, free, None)


def simulation_as_given(
    given: GivenPredictions | None,
    fits: tuple[RecordingFit, ...],
    plant: Plant,
    where: Located | None,
    *,
    extended: bool = True,
) -> SimulationAsGiven | None:
    """What is reported of the simulation as `given`; None where there is none.

    **Arguments:**

    - `given`: what it predicts.
    - `fits`: the recordings, with the errors of all models.
    - `plant`: for units.
    - `where`: where it misses; None where that is not known.
    - `extended`: whether there is an extended model.
    """
    if given is None:
        return None
    words = "" if where is None else where.where
    return SimulationAsGiven(
        given.source,
        _sentence(given.source, fits, plant, words, extended),
        words,
        () if where is None else where.bins,
    )


def where_it_misses(
    given: GivenPredictions | None,
    base: View,
    drive: Drive,
    plant: Plant,
    scene: Scene,
    floor: Float[np.ndarray, "r b"],
    mapping: Callable[..., Iterable] = map,
    *,
    rule: Rule = Rule(),
) -> Located | None:
    """The map of the simulation as `given` over the recordings that have one, beside that of the base model; None where
    none has one that is finite throughout.

    **Arguments:**

    - `given`: what it predicts.
    - `base`: what the base model predicts: its observer says in which regime a sample lies.
    - `drive`: the base model.
    - `plant`: for units.
    - `scene`, `floor`, `mapping`: as in `grid_of`; `rule`: which places are reported.
    """
    if given is None:
        return None
    # What is not a number compares as false.
    rows = np.flatnonzero(given.there & (np.abs(given.free) < _FAR).all(axis=1))
    if not rows.size:
        return None
    part = scene.of(rows)
    own: View = rows_of(base, rows)
    simulated = dataclasses.replace(own, free=given.free[rows], e=_errors(given.free[rows], part))
    grid = grid_along(simulated, drive, plant, part, floor[rows], mapping, rule=rule)
    return grid.located(simulated, own, rule=rule)


def _errors(free: Float[np.ndarray, "r n"], scene: Scene) -> Float[np.ndarray, "r n"]:
    """The standardised errors of the `free` runs of a simulation one sample ahead, comparable with the innovations of a
    model: of an observer that has the acceleration from the simulation. An offset and a drift at constant velocity are
    no errors of it; of a simulation that is right they are those of the sensor's noise."""
    batch = scene.batch
    off, noise = np.asarray(batch.answer) - free, np.asarray(batch.noise)
    e = np.zeros(off.shape)
    for row, length in enumerate(batch.lengths):
        own = off[row, :length]
        if scene.bandwidth[row] == 0.0:  # a motion that is imposed: the force has no observer
            e[row, :length] = own / noise[row]
            continue
        gains = observer_gains(scene.bandwidth[[row]], np.asarray(batch.dt)[[row]])
        (left,) = left_by_observer((own - own[0])[None], gains)
        e[row, :length] = left / (noise[row] * float(innovation_gain(gains, batch.integrated[row])[0]))
    return e * np.asarray(batch.valid)


def _sentence(
    source: Literal["column", "model"],
    fits: tuple[RecordingFit, ...],
    plant: Plant,
    where: str,
    extended: bool,
) -> str:
    """How far the simulation is from the recordings, held-out ones if any has it, and where it misses."""
    own = [fit for fit in fits if fit.free_given is not None]
    judged = [fit for fit in own if fit.role == "holdout"] or own
    on = "held-out recordings" if judged[0].role == "holdout" else "fitted recordings"
    imposed = judged[0].drive == "motion"
    unit = plant.shown_force if imposed else plant.shown_position
    subject = "simulation as given (column `simulated`)" if source == "column" else "model as given"
    models: tuple[ModelName, ...] = ("base", "extended") if extended else ("base",)

    def said(size: float) -> str:
        return f"{in_unit(unit, size)[1][0]:.3g}"

    def free(model: ModelName) -> str:
        return said(_rms([getattr(fit, f"free_run_rmse_{model}") for fit in judged]))

    def moves_by(model: ModelName) -> str:
        return said(_rms([getattr(fit, f"increment_rmse_{model}") for fit in judged]))

    others = " and ".join(f"the {model} model by {free(model)}" for model in models)
    text = (
        f"On the {on} your {subject} misses the measured {'force' if imposed else 'position'} by "
        f"{free('given')} {in_unit(unit)[0]} rms in a free run, {others}"
    )
    if not imposed:
        others = " and ".join(f"the {model} model by {moves_by(model)}" for model in models)
        text += f"; the motion of each 0.1 s it misses by {moves_by('given')}, {others}"
    if offset := _offset(judged):
        text += f". Most of that is a constant offset of {said(offset)} {in_unit(unit)[0]}"
    return f"{text}. It misses in: {where}." if where else f"{text}."


def _offset(fits: list[RecordingFit]) -> float:
    """The mean error of the simulation in the recordings of `fits`, where it makes most of the mean square error; else
    zero."""
    off = np.concatenate([fit.free_given - (fit.x if fit.force is None else fit.force) for fit in fits])
    with np.errstate(over="ignore", invalid="ignore"):
        mean = np.mean(off)
        most = mean**2 > 0.5 * np.mean(off**2)
    return float(mean) if most else 0.0


def _rms(errors: list[float]) -> float:
    """Root mean square of the `errors` of recordings, each with the same weight."""
    known = [error for error in errors if not np.isnan(error)]
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")
