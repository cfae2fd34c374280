"""How far base and extended model are off under the controller of the case, for each recording in closed loop."""

from collections.abc import Sequence
from typing import ClassVar

from markupsafe import Markup

from frictionjax.core.quantities import DisplayUnit
from frictionjax.diagnosis.recording_fit import ClosedLoop, RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis
from frictionjax.report.format import percent, quantities
from frictionjax.report.html import Cell, pair, table
from frictionjax.report.sections.base import AbstractSection
from frictionjax.report.series import holdout_first, is_extended
from frictionjax.report.template import fill

_ERRORS = (
    "Root mean square errors of free runs under the controller of the case, which answers to the simulated position as "
    "it answers to the measured one on the machine: how far the position is off, and the input that it gives."
)


class ClosedLoopSection(AbstractSection):
    """A table of the errors under the user's own controller."""

    title: ClassVar[str] = "Under your controller"

    def body(self, diagnosis: Diagnosis) -> Markup:
        recordings = [one for one in holdout_first(diagnosis.recordings) if one.closed_loop is not None]
        if not recordings:
            return Markup("")
        given = any(one.closed_loop is not None and one.closed_loop.given is not None for one in recordings)
        head = ["recording", "position", "input"]
        head += ["position, your model as given", "input, your model as given"] if given else []
        extended, plant = is_extended(diagnosis), diagnosis.plant
        rows = [
            [one.name, *_cells(one.closed_loop, plant.shown_position, plant.shown_input, extended, given)]
            for one in recordings
            if one.closed_loop is not None
        ]
        return fill("prose.html.j2", sentences=[_ERRORS, *_laws(recordings)], below=table(head, rows))


def _cells(
    errors: ClosedLoop,
    position: str | DisplayUnit,
    given_input: str | DisplayUnit,
    extended: bool,
    given: bool,
) -> list[Cell]:
    """The `errors` of one recording, in units of `position` and of the input."""
    base, after = quantities([errors.base, errors.extended], position)
    first, then = quantities([errors.input_base, errors.input_extended], given_input)
    cells: list[Cell] = [pair(base, after if extended else None), pair(first, then if extended else None)]
    own = ((errors.given, position), (errors.input_given, given_input)) if given else ()
    return [*cells, *("–" if size is None else quantities([size], unit)[0] for size, unit in own)]


def _laws(recordings: Sequence[RecordingFit]) -> list[str]:
    """How much of the recorded input the gains of the controller make, as a sentence."""
    shares = [
        f"{percent(one.closed_loop.law)} in {one.name}"
        for one in recordings
        if one.closed_loop is not None and one.closed_loop.law is not None
    ]
    if not shares:
        return []
    return [
        f"Of the variance of the recorded input its gains make {', '.join(shares)} out of the recorded reference; the "
        "rest counts as feedforward."
    ]
