"""`diagnose_arm`: the friction of each joint of an arm, from logs of all of them and a rigid-body model."""

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from frictionjax.arm.diagnosis import ArmDiagnosis, JointDiagnosis
from frictionjax.arm.fit_rigid_body import RigidBodyFit, fit_rigid_body
from frictionjax.arm.read_log import ArmData
from frictionjax.core import InputError, Progress, reporting, require_x64
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.rule import Rule
from frictionjax.recordings.words import listed, nearest, shown

_BEFORE = 0.02  # of the time: the fit of the rigid bodies


def diagnose_arm(
    logs: ArmData,
    model: str | Path,
    *,
    holdout: ArmData | Sequence[Any] = (),
    joints: Sequence[str] | None = None,
    only: Sequence[str] = (),
    columns: Mapping[str, str | Sequence[str]] | None = None,
    sample_rate: float | None = None,
    limit: float | None = None,
    executor: Executor | None = None,
    progress: Progress | bool = True,
    rule: Rule = Rule(),
    effort: Effort = Effort(),
) -> ArmDiagnosis:
    """Name what is missing in the friction of each joint of an arm.

    Base parameters of the rigid bodies are refitted to the logs, the friction of the joints free beside them
    (`fit_rigid_body`). What they leave of the torque of a joint is diagnosed as the friction of an imposed motion, one
    joint after the other.

    **Arguments:**

    - `logs`: an `ArmLog`, the path of a file, a DataFrame, or a list of these.
    - `model`: a MuJoCo or URDF model: the path of the file, or its text.
    - `holdout`: logs that are held out; of a single log, that is its last third, with a warning.
    - `joints`, `columns`, `sample_rate`, `limit`: as in `fit_rigid_body`.
    - `only`: joints to diagnose; empty: all of them. The rigid bodies need the logs of all.
    - `executor`, `rule`, `effort`: as in `diagnose`.
    - `progress`: called with the stage and the fraction done; True: a bar on a terminal and in a notebook; False:
        nothing.

    **Returns:** an `ArmDiagnosis`: a table of all joints, and a `Diagnosis` of each. A joint that cannot be diagnosed,
    as it hardly moves, is there with the reason.

    **Raises:** `InputError` for a log or a model that cannot be used, and where their joints differ; `PrecisionError`
    unless JAX computes in float64.
    """
    require_x64()
    start = time.perf_counter()
    with reporting(progress) as report:
        report("rigid bodies", 0.0)
        fit = fit_rigid_body(
            logs,
            model,
            holdout=holdout,
            joints=joints,
            columns=columns,
            sample_rate=sample_rate,
            limit=limit,
        )
        wanted = _wanted(fit, only)
        found = []
        for joint in fit.arm.joints:
            if joint not in wanted:
                found.append(JointDiagnosis(joint, None, "It was not asked for."))
                continue
            part = (1.0 - _BEFORE) / len(wanted)
            stage = _stage(report, joint, _BEFORE + part * wanted.index(joint), part)
            found.append(_joint(fit, joint, executor, stage, rule, effort))
    seconds = time.perf_counter() - start
    return ArmDiagnosis(fit.logs[0].name, fit, tuple(found), fit.said_of_parameters(), seconds)


def _wanted(fit: RigidBodyFit, only: Sequence[str]) -> list[str]:
    for joint in only:
        if joint not in fit.arm.joints:
            near = nearest(joint, fit.arm.joints)
            hint = f"Did you mean `{shown(near)}`? " if near else ""
            raise InputError(
                f"there is no joint `{shown(joint)}`",
                place="`only`",
                cure=f"{hint}The logs have: {listed(fit.arm.joints)}",
            )
    return [joint for joint in fit.arm.joints if not only or joint in only]


def _stage(report: Progress, joint: str, start: float, part: float) -> Progress:
    return lambda stage, fraction: report(f"{joint}: {stage}", start + part * fraction)


def _joint(
    fit: RigidBodyFit,
    joint: str,
    executor: Executor | None,
    progress: Progress,
    rule: Rule,
    effort: Effort,
) -> JointDiagnosis:
    try:
        found = diagnose(fit.case(joint), executor=executor, progress=progress, rule=rule, effort=effort)
    except InputError as error:  # of this joint alone, and said in its row
        return JointDiagnosis(joint, None, str(error))
    return JointDiagnosis(joint, found)
