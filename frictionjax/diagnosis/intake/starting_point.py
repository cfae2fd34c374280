"""The starting point of a diagnosis: the recordings of a case in arrays, and starting values estimated from them.

All recordings of a case are of one kind: an input was applied and the position measured, or the motion was imposed and
the friction force measured.
"""

import dataclasses

import equinox as eqx
import numpy as np
from jaxtyping import Bool

from frictionjax.core import InputError
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.intake.checks import check_simulated, check_usable
from frictionjax.diagnosis.intake.own_model import OwnModel, own_model, starting_values_beside
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import AbstractBatch, least_samples, make_batch, steps_a_sample
from frictionjax.estimation.data.imposed_batch import make_imposed_batch
from frictionjax.estimation.start.driven import StartingValues
from frictionjax.estimation.start.imposed import starting_values_imposed
from frictionjax.physics import VelocityOffset
from frictionjax.recordings import Case, Recording

_INTEGRATED = (
    "Positions are integrated velocities: the base model contains the offset of their sensor, and a force of the "
    "position shows only within each recording."
)
_NO_INERTIA = "The motion is imposed, so no inertia acts and none is identified."


class StartingPoint(eqx.Module):
    """The `recordings` of a case, the fitted ones first; the same in arrays, `batch`; which are `held_out` (bool, shape
    `(r,)`); the starting values, `start`; what the user knows of the base model, `own`; and `notes`, sentences for the
    warnings."""

    recordings: tuple[Recording, ...]
    batch: AbstractBatch
    held_out: Bool[np.ndarray, " r"]
    start: StartingValues
    own: OwnModel
    notes: tuple[str, ...] = eqx.field(static=True)

    @property
    def imposed(self) -> bool:
        """Whether the motion is imposed."""
        return self.batch.imposed

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(recording.name for recording in self.recordings)


def starting_point(case: Case) -> StartingPoint:
    """Estimate starting values from the fitted recordings of a `case` that passes `check`."""
    plant, recordings = case.plant, case.fit_recordings + case.holdout_recordings
    start, own = starts_of(case)
    held_out = np.array([recording.role == "holdout" for recording in recordings])
    if recordings[0].drive == "motion":
        batch = make_imposed_batch(recordings)
        return StartingPoint(
            recordings, batch, held_out, start, own, (*start.notes, _NO_INERTIA, *_said(own))
        )
    batch = make_batch(recordings, encoder_step=plant.encoder_step)
    no_constant = "The motor constant is unknown: every force is per input unit."
    notes = () if plant.motor_constant is not None else (no_constant,)
    return StartingPoint(recordings, batch, held_out, start, own, (*start.notes, *notes, *_said(own)))


def starts_of(case: Case) -> tuple[StartingValues, OwnModel]:
    """Starting values of the fitted recordings of a `case`, with what its own model gives, and the input held where
    nothing else was decided; and that model."""
    own = own_model(case)
    if case.fit_recordings[0].drive == "force":
        start, own = starting_values_beside(own, case)
        hold = "linear" if case.plant.hold == "linear" else "zero"
        drives = tuple(dataclasses.replace(drive, hold=hold) for drive in start.drives)
        return dataclasses.replace(start, drives=drives), own
    start = starting_values_imposed(case.fit_recordings, inertia=case.plant.inertia)
    return dataclasses.replace(start, drives=tuple(own.applied(drive) for drive in start.drives)), own


def _said(own: OwnModel) -> tuple[str, ...]:
    """What the report says of the user's `own` model."""
    names = ", ".join(effect.name for effect in own.effects if not isinstance(effect, VelocityOffset))
    fixed = sorted(path.split(".")[-1] for path in own.fixed if path != "J")
    said = (f"As the case says, the base model contains {names}.",) if names else ()
    said = (*said, _INTEGRATED) if any(isinstance(effect, VelocityOffset) for effect in own.effects) else said
    return (*said, f"Fixed by the case: {', '.join(fixed)}.") if fixed else said


def check(case: Case, *, rule: Rule = Rule(), effort: Effort = Effort()) -> None:
    """Raise the `InputError` for a `case` that cannot be diagnosed, or not with this `effort`."""
    imposed = [recording.name for recording in case.recordings if recording.drive == "motion"]
    if imposed and len(imposed) < len(case.recordings):
        raise InputError(
            f'drive = "motion" in some of the recordings ({", ".join(imposed)}) and "force" in the others',
            file=case.name,
            cure="split it into two cases, one for each kind, and diagnose each of them",
        )
    for recording in case.recordings:
        least = least_samples(recording.sample_rate)
        if recording.x.size < least:
            raise InputError(
                f"{recording.x.size} samples are too few for a diagnosis",
                file=case.name,
                place=f"recording {recording.name}",
                cure=f"at {recording.sample_rate:g} Hz at least {least} are needed; leave it out or record longer",
            )
    if not case.fit_recordings or not case.holdout_recordings:
        raise InputError(
            "a diagnosis needs recordings to fit and at least one held-out recording",
            file=case.name,
            cure='give one recording role = "holdout": it decides whether a name is accepted; for a single recording, '
            "`hold_out_last_third(case)` holds out its last third",
        )
    names = [recording.name for recording in case.recordings]
    if len(set(names)) < len(names):
        raise InputError(
            f"two recordings have the name {max(names, key=names.count)}",
            file=case.name,
            cure="give each a name of its own: results are listed by it",
        )
    check_simulated(case)
    if not imposed:
        _check_cost(case, effort)
        check_usable(case, rule=rule)


def _check_cost(case: Case, effort: Effort) -> None:
    """Refuse a case whose recordings take too many integration steps: at a low sample rate each sample takes many."""
    slowest = min(recording.sample_rate for recording in case.recordings)
    steps = steps_a_sample(case.recordings) * sum(recording.x.size for recording in case.recordings)
    if steps > effort.longest_run:
        raise InputError(
            f"one run of all recordings, the slowest at {slowest:.4g} Hz, takes {steps:.2g} integration steps, "
            f"more than the limit of {effort.longest_run:.2g}",
            file=case.name,
            cure="if the time column is in ms, set scale = {t = 1e-3}; else leave recordings out, or allow it: "
            "diagnose(case, effort=Effort(longest_run=...))",
        )
