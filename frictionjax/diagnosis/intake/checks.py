"""What a case must contain before anything is computed from it: finite numbers, an input, and motion."""

import numpy as np

from frictionjax.core import InputError
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import noise_level
from frictionjax.recordings import Case, Recording

_AVERAGED = 0.05  # s


def check_usable(case: Case, *, rule: Rule = Rule()) -> None:
    """Refuse the force-driven recordings of a `case` from which nothing can be identified; `rule`: what is motion.

    **Raises:** `InputError` for a motor constant that is not a positive number, for channels that are not finite, for a
    position that never changes or an input that is zero throughout, and when the machine moves in none of the fitted
    recordings.
    """
    constant = case.plant.motor_constant
    if constant is not None and not (np.isfinite(constant) and constant > 0.0):
        raise InputError(
            f"the motor constant is {constant:g}, it must be positive",
            file=case.name,
            place="plant",
            cure="Make it positive, or leave it out (None); if a positive u moves x backwards, reverse the sign of u",
        )
    for recording in case.recordings:
        _check_channels(case, recording)
    if not any(_moves(recording, case.plant.encoder_step, rule) for recording in case.fit_recordings):
        raise InputError(
            "the machine moves in none of the recordings to fit: x is only noise",
            file=case.name,
            cure="Drive it harder, or check which column is x and that the input reaches the machine",
        )


def _check_channels(case: Case, recording: Recording) -> None:
    place = f"recording {recording.name}"
    for channel, values in (("u", recording.u), ("x", recording.x)):
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            raise InputError(
                f"{wrong.size} values of {channel} are not finite, the first at sample {wrong[0]}",
                file=case.name,
                place=place,
                cure="Correct them, or use a part of the recording without them",
            )
    if np.ptp(recording.x) == 0.0:
        raise InputError(
            f"x is constant ({recording.x[0]:.6g})",
            file=case.name,
            place=place,
            cure="Check the sensor, or leave the recording out",
        )
    if not np.any(recording.u):
        raise InputError(
            "u is zero throughout",
            file=case.name,
            place=place,
            cure="Check that u is the input that was applied, or leave the recording out",
        )


def check_simulated(case: Case) -> None:
    """Raise the `InputError` for a recording of the `case` whose `simulated` is not one finite number a sample."""
    for recording in case.recordings:
        if recording.simulated is None:
            continue
        shape, size = np.shape(recording.simulated), recording.x.size
        if shape != (size,):
            problem = f"`simulated` has the shape {shape}, and there are {size} samples"
        elif wrong := np.flatnonzero(~np.isfinite(recording.simulated)).tolist():
            problem = f"{len(wrong)} values of simulated are not finite, the first at sample {wrong[0]}"
        else:
            continue
        raise InputError(
            problem,
            file=case.name,
            place=f"recording {recording.name}",
            cure="Simulate the whole recording, sample by sample, or leave `simulated` out",
        )


def _moves(recording: Recording, encoder_step: float | None, rule: Rule) -> bool:
    """Whether `x` varies by more than white noise does, by the `rule`: in its samples, or in its means over 50 ms."""
    noise, x = noise_level(recording, encoder_step), recording.x
    size = max(round(_AVERAGED * recording.sample_rate), 1)
    means = x[: x.size // size * size].reshape(-1, size).mean(axis=1)
    return is_motion(float(np.std(x) / noise), float(np.std(means) * np.sqrt(size) / noise), rule)


def is_motion(spread: float, drift: float, rule: Rule) -> bool:
    """Whether a position moves, by the `rule`, whose standard deviation is `spread` times that of its noise, and that
    of its means over 50 ms `drift` times that of means of noise."""
    return spread > rule.testable.still or drift > rule.testable.drift
