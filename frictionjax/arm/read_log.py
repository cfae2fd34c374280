"""Logs of an arm from files and tables in memory."""

import dataclasses
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from frictionjax.arm.columns import joint_columns, unit_in
from frictionjax.arm.log import ArmLog
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings.frame import Frame, is_frame, recording_from_table, table_of
from frictionjax.recordings.hold_out import PART
from frictionjax.recordings.limits import reading
from frictionjax.recordings.readers import AbstractColumnTable, open_table, stem
from frictionjax.recordings.recording import Plant
from frictionjax.recordings.units import parse_unit, split_unit
from frictionjax.recordings.words import require_file, shown

ArmData = ArmLog | str | Path | Frame | Sequence[ArmLog | str | Path | Frame]
"""An `ArmLog`, the path of a file, a table in memory, or several of these."""

PLANTS = {
    True: Plant(1.0, "rad", "N*m", "N*m"),
    False: Plant(1.0, "m", "N", "N"),
}
"""Units of a hinge, and of a slide."""


def read_arm_log(
    data: str | Path | Frame,
    joints: Sequence[str] = (),
    *,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    name: str | None = None,
    role: Literal["fit", "holdout"] = "fit",
    sample_rate: float | None = None,
    limit: float | None = None,
) -> ArmLog:
    """A log of an arm, read and checked joint by joint like other recordings.

    Columns are found by the names of joints (`elbow.position`, `elbow.effort`), or by their numbers (`q1`, `tau1`,
    `joint 3 position`). Units in headers are converted; without one rad and N m, or m and N, are meant.

    **Arguments:**

    - `data`: the path of a file, or a table in memory.
    - `joints`: names of the model's joints, for columns that are called after them.
    - `columns`: which columns are which: `{"q": ["a", "b"], "tau": ["c", "d"], "t": "e"}`, in the order of the joints.
    - `name`: of the log; None: that of the file.
    - `role`: `"fit"` or `"holdout"`.
    - `sample_rate`: Hz, where there is no column of time.
    - `limit`: the most that is read of one file, unpacked, GB; None: 0.5 GB.

    **Returns:** the `ArmLog`.

    **Raises:** `InputError` for a column that is missing, and for whatever makes a recording unusable.
    """
    with reading(limit):
        if isinstance(data, str | Path):
            path = require_file(Path(data))
            table, name = open_table(path), name or stem(path)
        else:
            name = name or "log"
            table = table_of(data, name)
        found = joint_columns(table, joints, columns or {})
        labels = found.joints or tuple(str(k + 1) for k in range(len(found.q)))
        parts = [
            _channel(table, f"{name}, joint {label}", q, tau, found.t, sample_rate)
            for label, q, tau in zip(labels, found.q, found.tau, strict=True)
        ]
    sizes = {(part.x.size, part.sample_rate, part.start_time) for part in parts}
    if len(sizes) > 1:
        raise InputError(
            "the joints have clocks that differ, or rows that repeat for some of them only",
            file=shown(table.path, 200),
            cure="Log all joints on one clock",
        )
    return ArmLog(
        name=name,
        sample_rate=parts[0].sample_rate,
        q=np.stack([part.x for part in parts], axis=1),
        tau=np.stack([np.asarray(part.force) for part in parts], axis=1),
        joints=found.joints,
        role=role,
        start_time=parts[0].start_time,
        warnings=tuple(part.warnings for part in parts),
    )


def _channel(
    table: AbstractColumnTable, name: str, q: str, tau: str, time: str, sample_rate: float | None
) -> Any:
    """Position and torque of one joint as a recording of an imposed motion."""
    length = parse_unit(table.unit(q) or split_unit(q)[1])
    plant = PLANTS[length is None or length.si != "m"]
    wanted = {"x": (q, plant.position_unit), "force": (tau, plant.force_unit)}
    units = {
        role: unit
        for role, (header, unit) in wanted.items()
        if not unit_in(header) and not table.unit(header)
    }
    chosen = {"x": q, "force": tau} | ({"t": time} if time else {})
    return recording_from_table(
        table, name, plant, drive="motion", columns=chosen, units=units, sample_rate=sample_rate
    )


def logs_of(
    data: ArmData,
    holdout: ArmData | Sequence[Any],
    joints: Sequence[str],
    columns: Mapping[str, str | Sequence[str]] | None,
    **how: Any,
) -> tuple[ArmLog, ...]:
    """All logs of one arm, of which some are held out: of a single one the last third, with a warning.

    **Arguments:**

    - `data`, `holdout`: those to fit and those held out.
    - `joints`, `columns`, `how`: as `read_arm_log` has them.
    """
    logs = [_log(one, joints, columns, None, how) for one in _each(data)]
    logs += [_log(one, joints, columns, "holdout", how) for one in _each(holdout)]
    if not logs:
        raise InputError("there is no log", place="`logs`", cure="Give at least one")
    if len(logs) == 1:
        logs = list(_last_third_held_out(logs[0]))
    for role in ("fit", "holdout"):
        if not any(log.role == role for log in logs):
            what = "to fit" if role == "fit" else "held out"
            raise InputError(f"no log is {what}", place="`holdout`", cure="Hold out one log of several")
    return _different_names(logs)


def _each(data: Any) -> list[Any]:
    if isinstance(data, ArmLog | str | Path) or is_frame(data):
        return [data]
    if not isinstance(data, Sequence):
        raise InputError(
            f"a {type(data).__name__} is no log of an arm",
            place="`logs`",
            cure="Give the path of a file, an `ArmLog`, a DataFrame, or a list of these",
        )
    return list(data)


def _log(
    data: Any,
    joints: Sequence[str],
    columns: Mapping[str, str | Sequence[str]] | None,
    role: Literal["holdout"] | None,
    how: dict[str, Any],
) -> ArmLog:
    if isinstance(data, ArmLog):
        return data if role is None else dataclasses.replace(data, role=role)
    return read_arm_log(data, joints, columns=columns, role=role or "fit", **how)


def _last_third_held_out(log: ArmLog) -> tuple[ArmLog, ArmLog]:
    cut = log.q.shape[0] - log.q.shape[0] // PART
    said = (
        f"{log.name}: there is no log for validation, and its last third was held out. "
        "A second log validates better."
    )
    warnings.warn(FrictionjaxWarning(said), stacklevel=2)
    later = log.start_time + cut / log.sample_rate
    return (
        dataclasses.replace(log, q=log.q[:cut], tau=log.tau[:cut], role="fit"),
        dataclasses.replace(
            log,
            name=f"{log.name}_last_third",
            q=log.q[cut:],
            tau=log.tau[cut:],
            role="holdout",
            start_time=later,
            warnings=(),
        ),
    )


def _different_names(logs: Sequence[ArmLog]) -> tuple[ArmLog, ...]:
    found, taken = [], set()
    for log in logs:
        name, number = log.name, 1
        while name.casefold() in taken:
            number += 1
            name = f"{log.name}_{number}"
        taken.add(name.casefold())
        found.append(log if name == log.name else dataclasses.replace(log, name=name))
    return tuple(found)
