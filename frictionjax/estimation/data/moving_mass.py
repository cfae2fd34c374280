"""A force cell with a mass behind it: under an imposed motion it measures friction and the force that moves the mass.

    F = friction + J d2x/dt2

Where the inertia J is known, its force is taken off. The acceleration is that of local polynomials of fourth order
(Savitzky, Golay 1964) over the shortest window in which the noise of the position adds no more to the force than the
noise that the force has, but none that cuts the motion off: a wider one must agree with the one before to within the
noise of that (Lepski 1991).
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.estimation.data.given import DataPiece
from frictionjax.estimation.data.observation import Observation
from frictionjax.recordings import Case, Recording
from frictionjax.recordings.recording import Given, GivenModel
from frictionjax.recordings.signals import noise_std

_ORDER = 4  # of the polynomials: the acceleration of a fifth-order motion is exact in the middle
_SHORTEST, _LONGEST = 7, 1001  # samples of a window
_WIDER = 1.4  # a window over the one before
_LONGEST_PART = 0.25  # of a recording
_QUIET = 1e-3  # noise of a force, over its standard deviation, below which no window must go
_CUT = 1.2  # difference of two windows, over the noise of the narrower one, beyond which the wider cuts motion off
_LOUD = 2.0  # noise of what is taken off, over that of the force, beyond which it is said


class _Smoothed(NamedTuple):
    """Second derivative of a position by polynomials over `seconds`, and its `noise`."""

    values: Float[np.ndarray, " n"]
    seconds: float
    noise: float


def case_without_moving_mass(case: Case) -> Case:
    """The `case`, with the force of its known inertia taken off what is measured under imposed motions: the plant has
    none then, as no inertia acts, and the user's own model keeps its value."""
    inertia = case.plant.inertia
    if inertia is None or not any(one.drive == "motion" for one in case.recordings):
        return case
    plant = dataclasses.replace(case.plant, inertia=None)
    model = case.model or GivenModel()
    own = model.parameters.get("J")
    if own is not None and own.value != inertia:
        raise InputError(
            f"J is {own.value:g} in the model, and the plant has the inertia {inertia:g}",
            file=case.name,
            cure="Leave one of them out",
        )
    parameters = {**model.parameters, "J": Given(inertia, fixed=True)}
    return dataclasses.replace(
        case,
        plant=plant,
        recordings=tuple(
            dataclasses.replace(without_moving_mass(one), plant=plant) for one in case.recordings
        ),
        model=dataclasses.replace(model, parameters=parameters),
    )


def pieces_without_moving_mass(pieces: Sequence[DataPiece]) -> tuple[tuple[DataPiece, ...], tuple[str, ...]]:
    """The `pieces` of a fit, recordings as by `without_moving_mass`; and what is said of it, once each."""
    changed, said = [], []
    for piece in pieces:
        recording = piece.data if isinstance(piece, Observation) else piece
        if not isinstance(recording, Recording):
            changed.append(piece)
            continue
        friction = without_moving_mass(recording)
        said += friction.warnings[len(recording.warnings) :]
        changed.append(
            dataclasses.replace(piece, data=friction) if isinstance(piece, Observation) else friction
        )
    return tuple(changed), tuple(dict.fromkeys(said))


def without_moving_mass(recording: Recording) -> Recording:
    """The `recording` of an imposed motion, with the force of the known inertia of its plant taken off the measured
    force (and off that of a simulation, `simulated`), and a warning that says so; any other one as it is."""
    plant = recording.plant
    if plant is None or plant.inertia is None or recording.drive != "motion" or recording.force is None:
        return recording
    inertia = plant.inertia
    acceleration, seconds, noise = _acceleration(recording, inertia)
    taken = inertia * acceleration
    unit = f"{plant.force_unit}*s^2/{plant.position_unit}"
    said = (
        f"The force of the inertia, {inertia:g} {unit} times the acceleration over {1e3 * seconds:.3g} ms, is taken "
        "off the measured force"
    )
    if noise > _LOUD:
        said += f"; the noise of the position in it is {noise:.2g} times that of the force: record the position finer"
    simulated = None if recording.simulated is None else np.asarray(recording.simulated) - taken
    return dataclasses.replace(
        recording,
        force=np.asarray(recording.force) - taken,
        simulated=simulated,
        warnings=(*recording.warnings, f"{said}."),
    )


def _acceleration(recording: Recording, inertia: float) -> tuple[Float[np.ndarray, " n"], float, float]:
    """Acceleration of the `recording`, position units/s^2, shape `(n,)`; the window of its polynomials, s; and the
    noise that it gives to the force of the `inertia`, over that of the measured force."""
    x, dt = np.asarray(recording.x, dtype=float), 1.0 / recording.sample_rate
    force = np.asarray(recording.force, dtype=float)
    plant = recording.plant
    step = 0.0 if plant is None or plant.encoder_step is None else plant.encoder_step
    of_position = max(noise_std(x), step / math.sqrt(12.0))
    of_force = max(noise_std(force), _QUIET * float(np.std(force)), np.finfo(float).tiny)
    longest = min(_LONGEST, int(_LONGEST_PART * x.size))
    window, chosen = _SHORTEST, None
    while chosen is None or (chosen.noise > of_force / inertia and window <= longest):
        weights = scipy.signal.savgol_coeffs(window, _ORDER, deriv=2, delta=dt)
        values = scipy.signal.savgol_filter(x, window, _ORDER, deriv=2, delta=dt)
        found = _Smoothed(np.asarray(values), window * dt, of_position * float(np.linalg.norm(weights)))
        # Two windows differ by the noise of the narrower one, unless the wider one cuts the motion off.
        if chosen is not None and np.std(found.values - chosen.values) > _CUT * chosen.noise:
            break
        chosen, window = found, 2 * math.ceil(_WIDER * window / 2.0) + 1
    return chosen.values, chosen.seconds, inertia * chosen.noise / of_force
