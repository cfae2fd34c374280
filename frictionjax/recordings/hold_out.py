"""Hold out the end of a single recording: a model can only be validated on data that it was not fitted to."""

import dataclasses
import warnings
from typing import Any

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings.recording import Case, Recording

PART = 3
"""One part in so many is held out."""
_LEAST = 100  # samples in the held-out part
_CHANNELS = ("u", "x", "v", "force", "reference", "temperature", "normal_force", "supply", "simulated")


def hold_out_last_third(case: Case) -> Case:
    """The case with the last third of its only recording held out, under the name `<name>_last_third`.

    The end of a run is no independent experiment: it shares the run's operating point, and cannot validate what shows
    only at its beginning. A second recording is better, and the warning says so.

    **Arguments:**

    - `case`: a case of one recording, whatever its role.

    **Returns:** a `Case` of two recordings, on one clock; the warning is among those of the first.

    **Raises:** `InputError` when the case has more recordings than one, or when that one is too short to be divided.
    Warns with `FrictionjaxWarning`.
    """
    if len(case.recordings) != 1:
        raise InputError(
            f"there are {len(case.recordings)} recordings, and only a single one is divided",
            file=case.name,
            cure='Give one of them role = "holdout"',
        )
    (recording,) = case.recordings
    kept = recording.x.size // PART
    if kept < _LEAST:
        raise InputError(
            f"{recording.x.size} samples are too few to hold out a third of them",
            file=case.name,
            place=f"recording {recording.name}",
            cure=f"Record at least {PART * _LEAST} samples, better several seconds, or name another file as holdout",
        )
    cut = recording.x.size - kept
    said = (
        f"There is no recording for validation: the last third ({kept / recording.sample_rate:.3g} s) was held out and "
        "not fitted. A second recording validates better, as a run's end resembles its beginning."
    )
    warnings.warn(FrictionjaxWarning(f"{recording.name}: {said}"), stacklevel=2)
    first = _part(recording, slice(None, cut), role="fit", warnings=(*recording.warnings, said))
    last = _part(
        recording,
        slice(cut, None),
        role="holdout",
        name=f"{recording.name}_last_third",
        start_time=recording.start_time + cut / recording.sample_rate,
        warnings=(),
    )
    return dataclasses.replace(case, recordings=(first, last))


def _part(recording: Recording, part: slice, **changes: Any) -> Recording:
    channels = {name: getattr(recording, name) for name in _CHANNELS}
    cut = {name: values[part].copy() for name, values in channels.items() if values is not None}
    return dataclasses.replace(recording, **cut, **changes)
