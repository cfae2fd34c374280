"""A real machine: the best linear approximation of a motor bench, and how far from linear it is.

The recordings are those of two inertias on a flexible coupling that Ohnishi's FdiTools carries (MIT licence): motor
current, motor angle and motor speed, 2500 samples a second, 20 periods of a second each. Type B is a random-phase
multisine on 60 odd lines, so that silent odd and even lines show the distortion.
"""

from pathlib import Path

import equinox as eqx
import numpy as np

from frictionjax.core import InputError
from frictionjax.frequency import BLA, best_linear_approximation, resonances
from frictionjax.recordings import case_from_files

FILES = ("MultisineTypeB.mat", "MultisineTypeA.mat")
RATE, PERIOD = 2500.0, 2500
LINES = tuple(range(13, 250, 4))  # Hz, as a period is a second
SEARCH = (30.0, 120.0)  # Hz
TRANSIENT = 2  # periods left out, as in the published analysis of these recordings
PUBLISHED = {"odd": 12.0, "even": 6.0, "antiresonance": 50.0, "resonance": 70.0}
"""A published analysis of the recording: distortion over noise, and frequencies in Hz."""


class MotorBench(eqx.Module):
    """Motor speed against motor current.

    **Attributes:**

    - `bla`: the best linear approximation, (rad/s)/A.
    - `antiresonance`: where the load swings against a motor that stands still, Hz; None if none shows.
    - `resonance`: where both swing, Hz; None if none shows.
    - `odd`, `even`: root mean square of the output on silent odd and even lines over that of the noise there.
    """

    bla: BLA
    antiresonance: float | None = eqx.field(static=True)
    resonance: float | None = eqx.field(static=True)
    odd: float = eqx.field(static=True)
    even: float = eqx.field(static=True)


def motor_bench(folder: str | Path) -> MotorBench:
    """Read the recordings of the motor bench and find its best linear approximation.

    **Arguments:**

    - `folder`: where `FILES` are.

    **Returns:** the `MotorBench`.

    **Raises:** `InputError` when a file is not there or cannot be read.
    """
    folder = Path(folder)
    for name in FILES:
        if not (folder / name).is_file():
            raise InputError(
                f"there is no {name}",
                file=folder,
                cure="Give the folder of the multisine recordings of the motor bench.",
            )
    odd, full = (str(folder / name) for name in FILES)
    columns = {"u": "iq_adx", "x": "theta_mx", "v": "omega_max"}
    recording = case_from_files(odd, full, sample_rate=RATE, columns=columns).fit_recordings[0]
    if recording.v is None:
        raise InputError("there is no motor speed", file=odd, cure="The variable is called omega_max.")
    bla = best_linear_approximation(
        recording.u, recording.v, RATE, period=PERIOD, lines=LINES, transient=TRANSIENT
    )
    found = resonances(np.asarray(bla.frequency), np.asarray(bla.response), band=SEARCH)
    return MotorBench(
        bla=bla,
        antiresonance=found.antiresonance,
        resonance=found.resonance,
        odd=float(bla.odd.ratio),
        even=float(bla.even.ratio),
    )
