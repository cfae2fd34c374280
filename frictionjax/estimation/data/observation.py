"""One piece of data for a fit, and what is known of it; checks of the data that a user gives."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.estimation.data.batch import least_samples
from frictionjax.frequency import FRF
from frictionjax.recordings import Recording

_NO_MOTION = 3.5  # smallest steps of the sensor: a recording that moves no further has no information


class Observation(PlainMethods, eqx.Module):
    """A recording or a frequency response, with what is known of it.

    **Attributes:**

    - `data`: a `Recording` (`drive = "force"` or `"motion"`) or an `FRF` of the machine in stick.
    - `noise`: standard deviation of the measured position (of the force, for `drive = "motion"`); None: it is found.
    - `weight`: how much its cost counts; 1 for the likelihood itself.
    - `x0`, `v0`: position and velocity at the first sample; None: read from the first samples, and the filter goes on
        from there. The deflection of the bristle is always found.
    - `band`: Hz, of an `FRF`: the bins that count.
    - `hold`: of an `FRF`: whether the input was held between samples.
    """

    data: Recording | FRF
    noise: float | None = eqx.field(static=True, default=None)
    weight: float = eqx.field(static=True, default=1.0)
    x0: float | None = eqx.field(static=True, default=None)
    v0: float | None = eqx.field(static=True, default=None)
    band: tuple[float, float] = eqx.field(static=True, default=(1.0, float("inf")))
    hold: bool = eqx.field(static=True, default=True)


class Sorted(eqx.Module):
    """The observations of a fit by kind: `positions`, `forces`, `responses`; and `notes`, sentences for the message."""

    positions: tuple[Observation, ...]
    forces: tuple[Observation, ...]
    responses: tuple[Observation, ...]
    notes: tuple[str, ...] = eqx.field(static=True)


def sort_data(data: Sequence[Recording | FRF | Observation]) -> Sorted:
    """The `data` of a fit by kind, checked.

    **Raises:**

    `InputError` when there is none, a weight or noise is not positive, a recording is too short, nothing in it moves,
    or one with `drive = "motion"` has no force.
    """
    kinds: dict[str, list[Observation]] = {"positions": [], "forces": [], "responses": []}
    notes = []
    for one in data:
        own = one if isinstance(one, Observation) else Observation(one)
        if not own.weight > 0.0 or (own.noise is not None and not own.noise > 0.0):
            raise InputError(
                f"weight {own.weight} and noise {own.noise}", place="`data`", cure="Give positive numbers."
            )
        if isinstance(own.data, FRF):
            kinds["responses"].append(own)
            continue
        recording = own.data
        _check(recording)
        if np.ptp(recording.x) <= _NO_MOTION * _step(recording.x):
            notes.append(f"`{recording.name}` hardly moves: it has almost no information on the parameters.")
        kinds["forces" if recording.drive == "motion" else "positions"].append(own)
    if not any(kinds.values()):
        raise InputError(
            "there is nothing to fit",
            place="`data`",
            cure="Give at least one recording or frequency response.",
        )
    recordings = kinds["positions"] + kinds["forces"]
    if recordings and len(notes) == len(recordings) and not kinds["responses"]:
        raise InputError(
            "no recording moves by more than a few steps of its sensor",
            place="`data`",
            cure="Excite the machine more, or measure finer: without motion there is nothing to identify.",
        )
    return Sorted(**{kind: tuple(found) for kind, found in kinds.items()}, notes=tuple(notes))


def _step(x: Float[np.ndarray, " n"]) -> float:
    """Smallest step between two samples of `x`: that of the sensor, where it is coarse."""
    jumps = np.abs(np.diff(x))
    jumps = jumps[jumps > 0.0]
    return float(np.min(jumps)) if jumps.size else 0.0


def _check(recording: Recording) -> None:
    if recording.x.size < least_samples(recording.sample_rate):
        raise InputError(
            f"`{recording.name}` has {recording.x.size} samples; at {recording.sample_rate:g} Hz "
            f"it needs {least_samples(recording.sample_rate)}",
            place="`data`",
            cure="Leave it out, or record longer.",
        )
    channels = {"x": recording.x}
    if recording.drive == "motion":
        if recording.force is None:
            raise InputError(
                f'`{recording.name}` has drive = "motion", but no measured force',
                place="`data`",
                cure='Give the channel `force`, or drive = "force" if `u` was applied.',
            )
        channels["force"] = recording.force
    else:
        channels["u"] = recording.u
    for name, values in channels.items():
        if not np.all(np.isfinite(values)):
            raise InputError(
                f"`{name}` of `{recording.name}` holds {int(np.sum(~np.isfinite(values)))} values that are not finite",
                place="`data`",
                cure="Cut them out, or interpolate them.",
            )


def recordings_of(observations: tuple[Observation, ...]) -> tuple[Recording, ...]:
    """The recordings among the data of `observations`."""
    return tuple(one.data for one in observations if isinstance(one.data, Recording))


def responses_of(observations: tuple[Observation, ...]) -> tuple[FRF, ...]:
    """The frequency responses among the data of `observations`."""
    return tuple(one.data for one in observations if isinstance(one.data, FRF))
