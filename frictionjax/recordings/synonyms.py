"""Which column is which where no column has the name of its role: the names that people give to them."""

import re

from frictionjax.recordings.units import split_unit

SYNONYMS: dict[str, tuple[str, ...]] = {
    "t": (
        *(
            "time",
            "timestamp",
            "time stamp",
            "datetime",
            "date time",
            "elapsed",
            "elapsed time",
            "sec",
            "seconds",
        ),
        *("zeit", "zeitstempel", "temps"),
    ),
    "u": (
        *("input", "current", "voltage", "motor current", "motor voltage", "command", "cmd", "control"),
        *("control input", "i", "iq", "motor torque", "torque command", "commanded torque", "drive torque"),
        *("actuation", "effort", "pwm", "duty", "strom", "spannung", "stellgrösse", "iststrom"),
    ),
    "x": (
        *("position", "pos", "angle", "theta", "phi", "q", "y", "displacement", "encoder", "actual position"),
        *(
            "position actual",
            "measured position",
            "motor position",
            "joint position",
            "winkel",
            "weg",
            "lage",
            "istwert",
            "istposition",
        ),
    ),
    "v": (
        *("velocity", "vel", "speed", "omega", "angular velocity", "angular speed", "motor speed"),
        *("motor velocity", "actual speed", "actual velocity", "speed actual", "velocity actual"),
        *("joint velocity", "qd", "dq", "drehzahl", "geschwindigkeit", "istdrehzahl"),
    ),
    "force": ("friction", "friction force", "friction torque", "f", "measured force", "kraft", "load cell"),
    "simulated": (
        *("sim", "simulation", "simulated output", "model", "model output", "simulink", "simscape", "mujoco"),
    ),
}
"""Role -> names that people use for it, in lower case, words apart by blanks. Only for roles that a recording needs, a
velocity where there is no position, and for what a simulation gives; any other column that it can do without is never
taken by a guess."""
_SIMULATED = {
    "force": (
        *(
            "x sim",
            "sim x",
            "x simulated",
            "simulated x",
            "x model",
            "model x",
            "position sim",
            "sim position",
        ),
        *("position simulated", "simulated position", "position model", "model position", "angle sim"),
        *("simulated angle", "theta sim", "q sim", "y sim"),
    ),
    "motion": ("force sim", "sim force", "force simulated", "simulated force", "force model", "model force"),
}
"""What a simulation gives, where the motor drives and where the motion is imposed."""
_EITHER = ("torque", "moment", "drehmoment")
"""The input where the motor drives, and the measured force where the motion is imposed."""


def synonyms_of(role: str, drive: str) -> tuple[str, ...]:
    """The names that people use for a `role`, with a `drive` of `"force"` or `"motion"`."""
    names = SYNONYMS.get(role, ())
    if role == "simulated":
        return (*names, *_SIMULATED[drive])
    return (*names, *_EITHER) if role == ("force" if drive == "motion" else "u") else names


def plain_name(header: str) -> str:
    """A column's `header` without its unit, in lower case, its words apart by blanks: "Motor_Current [A]" is "motor
    current"."""
    name = split_unit(header)[0]
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return " ".join(re.split(r"[\s_\-./:]+", name.strip())).strip().lower()


def columns_like(role: str, drive: str, headers: tuple[str, ...], *, guess: bool) -> tuple[str, ...]:
    """The columns that may be a role, by their names.

    **Arguments:**

    - `role`: one of the roles of a case file.
    - `drive`: `"force"` or `"motion"`.
    - `headers`: the columns' names.
    - `guess`: whether names that people use for the role count.

    **Returns:** those whose name without unit is the role; else, if any `guess` is wanted, those with such a name.
    """
    plain = {header: plain_name(header) for header in headers}
    own = tuple(header for header, name in plain.items() if name == role.replace("_", " "))
    known = synonyms_of(role, drive) if guess else ()
    return own or tuple(header for header, name in plain.items() if name in known)
