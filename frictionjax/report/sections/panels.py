"""For each recording two charts side by side: the whole of it, and a close-up where the mismatch is largest."""

from collections.abc import Sequence
from typing import Any

from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.recordings import Plant
from frictionjax.report.figures import Draw
from frictionjax.report.format import number
from frictionjax.report.html import figure
from frictionjax.report.series import zoom

MOST = 24  # recordings that are drawn: a page of hundreds is not read


def panels(
    recordings: Sequence[RecordingFit], plant: Plant, extended: bool, draw: Draw
) -> tuple[list[dict[str, Any]], list[str]]:
    """Both charts of every recording, under the recording's name, and what is to be said below.

    **Arguments:**

    - `recordings`: in the order of the page; past the first `MOST` they are only counted.
    - `plant`, `extended`: handed to `draw`.
    - `draw`: one of `report.figures`.

    **Returns:**

    `groups` and `notes` of the template of charts.
    """
    groups = [_pair(recording, plant, extended, draw) for recording in recordings[:MOST]]
    left_out = len(recordings) - MOST
    notes = [f"{left_out} more recordings are not drawn; their series are in fit/*.csv."]
    return groups, notes if left_out > 0 else []


def _pair(recording: RecordingFit, plant: Plant, extended: bool, draw: Draw) -> dict[str, Any]:
    near = zoom(recording)
    first, last = (number(float(recording.t[k])) for k in (near.start, near.stop - 1))
    whole = figure(
        lambda: draw(recording, plant, extended, slice(None), near), f"{recording.name}, the whole of it"
    )
    close = figure(
        lambda: draw(recording, plant, extended, near),
        f"{recording.name}, close-up of the tinted {first} to {last} s",
    )
    return {"title": recording.name, "held_out": recording.role == "holdout", "figures": [whole, close]}
