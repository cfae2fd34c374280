"""A column of what a simulation of the user's gives for the same input: what it is compared with."""

import numpy as np
from jaxtyping import Float

from frictionjax.recordings.jumps import unwrapped
from frictionjax.recordings.recording import Plant
from frictionjax.recordings.words import shown

SIMULATED = "simulated"
"""The role of the column."""


def answer_of(drive: str) -> str:
    """The role of the measured answer, which a simulation gives: that of the position, or of the force where the motion
    is imposed; `drive` as in a case file."""
    return "force" if drive == "motion" else "x"


def no_simulation(values: Float[np.ndarray, " n"], column: str) -> str:
    """Why the `column` with these `values`, which was found by a name that people use, is no simulation; empty where it
    may be one."""
    wrong = int(np.count_nonzero(~np.isfinite(values)))
    why = f"has {wrong} values that are missing or no numbers" if wrong else "never changes"
    if not wrong and np.ptp(values) > 0.0:
        return ""
    return (
        f"`{shown(column, 40)}` {why}: it was not read as simulated. If it is the simulated answer, say so: "
        f'columns = {{{SIMULATED} = "{shown(column, 40)}"}}.'
    )


def on_the_turn_of(
    simulated: Float[np.ndarray, " n"], drive: str, plant: Plant
) -> tuple[Float[np.ndarray, " n"], tuple[str, ...]]:
    """A `simulated` answer as a measured one is read: an angle that wraps is unwrapped, and a sentence says so.

    **Arguments:**

    - `simulated`: shape `(n,)`, in the units of the case.
    - `drive`: `"force"` or `"motion"`.
    - `plant`: with the position unit.
    """
    if drive == "motion":
        return simulated, ()
    values, turns, _ = unwrapped(simulated, plant.position_unit)
    return values, ("The simulated position jumps by full turns: it was unwrapped.",) if turns else ()
