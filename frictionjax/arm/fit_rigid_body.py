"""`fit_rigid_body`: what rigid-body dynamics with refitted base parameters leave of the torques of an arm."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from frictionjax.arm.balance import balance, motion_of
from frictionjax.arm.base_parameters import BaseParameters, base_parameters
from frictionjax.arm.log import ArmLog
from frictionjax.arm.read_log import PLANTS, ArmData, logs_of
from frictionjax.arm.read_model import Robot, read_robot, rigid_body
from frictionjax.arm.rigid_body import RigidBody
from frictionjax.core import Estimate, InputError
from frictionjax.core.display import AbstractDisplayed, Display, TextGrid, estimates_grid
from frictionjax.core.frames import estimate_columns, records, to_dataframe
from frictionjax.recordings import Case, Recording
from frictionjax.recordings.words import listed

_LEAST = 100  # samples between the ends in which filters have not settled


class RigidBodyFit(AbstractDisplayed):
    """Rigid-body dynamics of an arm with base parameters that were refitted to its logs.

    **Attributes:**

    - `arm`: the bodies and joints, as the model has them.
    - `base`: which base parameters there are.
    - `values`, `stderr`: the refitted base parameters and their standard errors, shape `(b,)`.
    - `determined`: whether the logs determine each of them, shape `(b,)`; those that they do not are as in the model.
    - `logs`: those that were fitted, and those held out; without the ends in which filters have not settled.
    - `positions`: those of each of the `logs` without what is noise alone, shape `(n, j)`.
    - `torques`: the rigid-body torque along each of the `logs`, shape `(n, j)`; `given`: that of the model as it was.
    """

    arm: RigidBody
    base: BaseParameters
    values: Float[np.ndarray, " b"]
    stderr: Float[np.ndarray, " b"]
    determined: Bool[np.ndarray, " b"]
    logs: tuple[ArmLog, ...]
    positions: tuple[Float[np.ndarray, "_ j"], ...]
    torques: tuple[Float[np.ndarray, "_ j"], ...]
    given: tuple[Float[np.ndarray, "_ j"], ...]

    @property
    def parameters(self) -> dict[str, Estimate]:
        """The base parameters, each by the name of the parameter that leads its combination."""
        rows = zip(self.base.names, self.values, self.stderr, self.base.units, self.determined, strict=True)
        return {name: Estimate(float(v), float(e), unit, bool(k)) for name, v, e, unit, k in rows}

    def case(self, joint: str) -> Case:
        """The case of one `joint`: an imposed motion, and as its friction what the rigid bodies leave of the torque.

        The position is the filtered one: an imposed motion is taken to be exact, and bristles as short as its noise
        would take that for motion.

        **Raises:** `InputError` for a joint that the logs do not have.
        """
        if joint not in self.arm.joints:
            raise InputError(
                f"there is no joint `{joint}`",
                place="`joint`",
                cure=f"The logs have: {listed(self.arm.joints)}",
            )
        k = self.arm.joints.index(joint)
        recordings = [
            Recording(
                log.name,
                log.sample_rate,
                np.zeros(log.q.shape[0]),
                moved[:, k].copy(),
                role=log.role,
                drive="motion",
                start_time=log.start_time,
                force=log.tau[:, k] - torque[:, k],
                warnings=log.warnings[k] if log.warnings else (),
            )
            for log, moved, torque in zip(self.logs, self.positions, self.torques, strict=True)
        ]
        return Case(joint, PLANTS[bool(self.arm.hinge[k])], recordings)

    def left(self, role: Literal["fit", "holdout"], *, given: bool = False) -> Float[np.ndarray, " j"]:
        """Root mean square of what is left of the torque of each joint, shape `(j,)`.

        **Arguments:**

        - `role`: of the logs that count.
        - `given`: by the model as it was, in place of the refitted one.
        """
        bodies = self.given if given else self.torques
        rest = [log.tau - one for log, one in zip(self.logs, bodies, strict=True) if log.role == role]
        return np.sqrt(np.mean(np.concatenate(rest) ** 2, axis=0))

    def table(self) -> list[dict[str, Any]]:
        """A row for each joint: torque, and what the rigid bodies leave of it, root mean square."""
        torque = np.sqrt(np.mean(np.concatenate([log.tau for log in self.logs]) ** 2, axis=0))
        given, fitted, held_out = self.left("holdout", given=True), self.left("fit"), self.left("holdout")
        return [
            {
                "joint": joint,
                "torque": float(torque[k]),
                "left_as_given": float(given[k]),
                "left_fit": float(fitted[k]),
                "left_holdout": float(held_out[k]),
                "unit": PLANTS[bool(self.arm.hinge[k])].force_unit,
            }
            for k, joint in enumerate(self.arm.joints)
        ]

    def to_dataframe(self, what: Literal["joints", "parameters"] = "joints") -> Any:
        """A pandas DataFrame.

        **Arguments:**

        - `what`: `"joints"` (the `table`), or `"parameters"` (the base parameters).

        **Raises:** `ImportError` where pandas is missing.
        """
        if what == "parameters":
            return to_dataframe(estimate_columns(self.parameters), index="parameter")
        return to_dataframe(records(self.table()), index="joint")

    def said_of_parameters(self) -> tuple[str, ...]:
        """A sentence on base parameters that the logs do not determine; none where they determine all."""
        unknown = [name for name, known in zip(self.base.names, self.determined, strict=True) if not known]
        if not unknown:
            return ()
        return (
            f"The logs do not determine {len(unknown)} of {len(self.base.names)} base parameters, which stay as the "
            f"model has them: {listed(unknown, 6)}.",
        )

    def _display(self) -> Display:
        head = ("joint", "torque", "left, model as given", "left, to fit", "left, held out", "unit")
        keys = ("torque", "left_as_given", "left_fit", "left_holdout")
        rows = tuple(
            (row["joint"], *(f"{row[key]:.4g}" for key in keys), row["unit"]) for row in self.table()
        )
        title = (
            f"Rigid bodies of {len(self.arm.joints)} joints, {len(self.base.names)} base parameters refitted"
        )
        said = ("Root mean square torques; what is left is friction, and what the model lacks.",)
        grids = (TextGrid(head, rows), estimates_grid(self.parameters))
        return Display(title, (*said, *self.said_of_parameters()), grids)


def fit_rigid_body(
    logs: ArmData,
    model: str | Path,
    *,
    holdout: ArmData | Sequence[Any] = (),
    joints: Sequence[str] | None = None,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    sample_rate: float | None = None,
    limit: float | None = None,
) -> RigidBodyFit:
    """Refit the base parameters of an arm's rigid-body model to its logs, with the friction of its joints free beside
    them; held-out logs have no part in it.

    **Arguments:**

    - `logs`: an `ArmLog`, the path of a file, a DataFrame, or a list of these.
    - `model`: a MuJoCo or URDF model: the path of the file, or its text.
    - `holdout`: logs that are held out; of a single log, that is its last third, with a warning.
    - `joints`: names of the model's joints, in the order of the log's columns; None: by the names of columns, else all
        hinges and slides of the model. Joints that are not in the log are held where the model has them at first.
    - `columns`: which columns are which: `{"q": [...], "tau": [...], "t": "..."}`, in the order of the joints.
    - `sample_rate`: Hz, for logs without a column of time.
    - `limit`: the most that is read of one file, unpacked, GB; None: 0.5 GB.

    **Returns:** the `RigidBodyFit`; `fit.case(joint)` is what `diagnose` takes.

    **Raises:** `InputError` for a log or a model that cannot be used, and where their joints differ.
    """
    robot = read_robot(model)
    read = logs_of(logs, holdout, robot.movable, columns, sample_rate=sample_rate, limit=limit)
    arm = _arm_of(robot, read, tuple(joints or ()))
    base = base_parameters(arm)
    motions = [motion_of(log) for log in read]
    for log, motion in zip(read, motions, strict=True):
        rest = log.q.shape[0] - 2 * motion.edge
        if rest < _LEAST:
            raise InputError(
                f"{log.q.shape[0]} samples are too few: {max(rest, 0)} are left where filters have settled",
                file=log.name,
                cure=f"Record some seconds more, so that {_LEAST} are left",
            )
    fitted = [k for k, log in enumerate(read) if log.role == "fit"]
    found = balance(arm, base, [read[k] for k in fitted], [motions[k] for k in fitted])
    cut, positions, torques, given = [], [], [], []
    for log, motion in zip(read, motions, strict=True):
        kept = slice(motion.edge, log.q.shape[0] - motion.edge)
        columns_of = base.regressor(arm, motion.q[kept], motion.qd[kept], motion.qdd[kept])
        positions.append(motion.x[kept])
        torques.append(columns_of @ found.base)
        given.append(columns_of @ base.of(arm.values))
        later = log.start_time + motion.edge / log.sample_rate
        cut.append(dataclasses.replace(log, q=log.q[kept], tau=log.tau[kept], start_time=later))
    return RigidBodyFit(
        arm,
        base,
        found.base,
        found.stderr,
        found.determined,
        tuple(cut),
        tuple(positions),
        tuple(torques),
        tuple(given),
    )


def _arm_of(robot: Robot, logs: Sequence[ArmLog], joints: tuple[str, ...]) -> RigidBody:
    """The bodies that move with the joints of the `logs`, in the order of their columns."""
    named = {log.joints for log in logs if log.joints}
    if len(named) > 1:
        raise InputError(
            "the logs have columns of different joints",
            place="`logs`",
            cure="Give logs of the same joints, or name the columns",
        )
    wanted = next(iter(named), joints)
    if joints and set(wanted) != set(joints):
        raise InputError(
            f"the logs have columns of the joints {listed(wanted)}, and others were named: {listed(joints)}",
            place="`joints`",
            cure="Leave it out (--joints): the rigid bodies need every joint that moves",
        )
    arm = rigid_body(robot, wanted)
    for log in logs:
        count = log.q.shape[1]
        if log.tau.shape != log.q.shape:
            raise InputError(
                f"`q` has the shape {log.q.shape}, and `tau` {log.tau.shape}",
                file=log.name,
                cure="Give a column for each joint, and a row for each sample",
            )
        if count != len(arm.joints):
            whose = "were named" if wanted else f"are in the model: {listed(arm.joints)}"
            raise InputError(
                f"the log has {count} joint{'s' * (count != 1)}, and {len(arm.joints)} {whose}",
                file=log.name,
                cure="Name the joints of the log in the order of its columns: `joints` (--joints NAME ...)",
            )
    return arm
