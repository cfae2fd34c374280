"""The user's own controller, as a case file gives it."""

from collections.abc import Mapping, Sequence
from typing import Any

from frictionjax.recordings.controller import Controller
from frictionjax.recordings.recording import Recording
from frictionjax.recordings.schema import CONTROLLER_KEYS, Spot, known_keys, number, positive
from frictionjax.recordings.words import listed

_GAINS = ("kp", "ki", "kd")


def parse_controller(table: Any, recordings: Sequence[Recording], source: str | None) -> Controller | None:
    """The user's own controller.

    **Arguments:**

    - `table`: what stands under `[controller]`; None where nothing does.
    - `recordings`: those of the case.
    - `source`: the case file as text, for messages.

    **Returns:** the `Controller`; None where there is none.

    **Raises:** `InputError` for an unknown key, a wrong type, a number out of range, where all gains are zero, and
    where no recording was made in closed loop.
    """
    if table is None:
        return None
    spot = Spot(source, "[controller]" if source else "")
    if not isinstance(table, Mapping):
        Spot(source).fail(
            "the controller is not a table",
            "controller",
            "Write [controller] on a line, and its keys below it",
        )
    own = dict(table)
    known_keys(own, CONTROLLER_KEYS, spot)
    gains = {key: number(own, key, spot) or 0.0 for key in _GAINS}
    if not any(gains.values()):
        spot.fail(
            "the controller has no gain", cure=f"Give at least one of {listed(_GAINS)}, such as kp = 16.0"
        )
    if all(recording.loop == "open" for recording in recordings):
        spot.fail(
            "no recording was made in closed loop, and there is a controller",
            cure='Write loop = "closed" for those that it made (--loop closed), or leave the controller out',
        )
    limit = positive(own, "limit", spot, "Leave it out when the input has none")
    rate = positive(own, "rate", spot, "Give the controller's samples per second, such as 1000.0")
    return Controller(**gains, limit=float("inf") if limit is None else limit, rate=rate)
