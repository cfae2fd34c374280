"""Options that say of recordings what a case file would say."""

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from cyclopts import Group, Parameter

from frictionjax.cli.docstrings import options
from frictionjax.cli.kinds import File, Gigabytes, Hertz, Intervals, Several, named

GENERAL = Group("Options", sort_key=1)
_OF_A_CASE = Group(
    "for recordings without a case file (which sets these itself)",
    help="Roles of columns are t, u, x, v, force, reference, temperature, normal_force, supply, simulated. One option "
    "may carry several values; end them with another option, or write the files first.",
    sort_key=2,
)
_Unit = Annotated[str | None, Parameter(metavar="UNIT")]


@options
@Parameter(name="*", group=_OF_A_CASE)
@dataclass(frozen=True)
class CaseOptions:
    """What may be read, and the keys of a case file.

    - `allow_outside`: let the case file name recordings outside of its folder
    - `limit`: the most that is read of one file, unpacked (default: 0.5)
    - `holdout`: held-out recordings, which judge the result (by default, the last third of a single recording)
    - `name`: name of the case (default: that of the first file)
    - `motor_constant`: force or torque per input unit, when known
    - `inertia`: known inertia or mass (default: identified)
    - `encoder_step`: quantum of the position sensor, position units: SI where columns say theirs
    - `hold`: what the input does between samples: held (default), straight to the next one, or as is likelier
    - `position_unit`: unit of position, such as rad (default: where columns say theirs, SI, and what is read by people
        in that of the columns)
    - `force_unit`: unit of force, such as N*m (default: as for the position)
    - `input_unit`: unit of input, such as V (default: as for the position)
    - `sample_rate`: needed when files have no time column
    - `columns`: the column of each role, by its header or its number
    - `units`: the unit of a column, where its header does not say it: t=ms x=deg u=mA
    - `scale`: factors that columns are multiplied by to reach the units: u=-1
    - `loop`: closed: the input answers to the measured position (default: open)
    - `controller`: kp, ki, kd, limit and rate (Hz) of the controller of the position, for closed-loop free runs: kp=16
        kd=0.3
    - `drive`: force: the input is applied; motion: the position is imposed, the force is measured (default: force)
    - `start_time`: s since power-on of the first sample: one, or one for each file in order, held-out files last
    - `interval`: the part to use, s of the file's own time: one, or one for each file in order, held-out files last
    """

    allow_outside: Annotated[bool, Parameter(group=GENERAL)] = False
    limit: Annotated[Gigabytes | None, Parameter(group=GENERAL)] = None
    holdout: Several[File] = None
    name: Annotated[str | None, Parameter(metavar="TEXT")] = None
    motor_constant: Annotated[float | None, Parameter(metavar="KM")] = None
    inertia: Annotated[float | None, Parameter(metavar="J")] = None
    encoder_step: Annotated[float | None, Parameter(metavar="STEP")] = None
    hold: Literal["zero", "linear", "auto"] | None = None
    position_unit: _Unit = None
    force_unit: _Unit = None
    input_unit: _Unit = None
    sample_rate: Hertz | None = None
    columns: Annotated[list[tuple[str, str]] | None, named("ROLE=COLUMN", "x=Position")] = None
    units: Annotated[list[tuple[str, str]] | None, named("ROLE=UNIT", "x=mm"), Parameter("--unit")] = None
    scale: Annotated[list[tuple[str, float]] | None, named("ROLE=FACTOR", "u=-1", float)] = None
    loop: Literal["open", "closed"] | None = None
    controller: Annotated[list[tuple[str, float]] | None, named("KEY=NUMBER", "kp=16", float)] = None
    drive: Literal["force", "motion"] | None = None
    start_time: Several[Annotated[float, Parameter(metavar="S")]] = None
    interval: Intervals = None


_READING = ("allow_outside", "limit")
OPTIONS = {
    one.name: f"--{one.name.replace('_', '-')}" for one in fields(CaseOptions) if one.name not in _READING
}
OPTIONS["units"] = "--unit"
"""Key of a case -> the option that sets it for recordings without a case file."""
