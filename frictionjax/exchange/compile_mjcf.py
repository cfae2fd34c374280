"""A joint of a MuJoCo model as MuJoCo's own compiler has it: inertia and gravity of bodies made of shapes."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from frictionjax.core import InputError
from frictionjax.exchange.joint_text import INSTALL, JointText, held
from frictionjax.exchange.read_mjcf import checked_kind, missing
from frictionjax.exchange.rigid import JointLoad
from frictionjax.recordings.readers.extra import optional
from frictionjax.recordings.words import shown

_KINDS = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo


def compile_mjcf(text: str, file: Path | None, joint: str, plain: JointText | None) -> JointText:
    """The numbers of one joint.

    **Arguments:**

    - `text`: the model; `file`: where it stands, for what it includes; None for text alone.
    - `joint`: its name.
    - `plain`: what is read without MuJoCo; None where the joint itself is in another file.

    **Returns:** the numbers; without inertia and gravity, and with a remark, where MuJoCo is not installed.

    **Raises:** `InputError` for a model that MuJoCo refuses, and where the joint is not in it.
    """
    mujoco: Any = optional("mujoco")
    if mujoco is None:
        if plain is None:
            raise InputError("must be compiled by MuJoCo", file=file, cure=f"Run {INSTALL}")
        remark = f"Inertia and gravity of the bodies follow from their shapes; to have them, run {INSTALL}"
        return dataclasses.replace(plain, remarks=(*plain.remarks, remark))
    try:
        model = (
            mujoco.MjModel.from_xml_string(text) if file is None else mujoco.MjModel.from_xml_path(str(file))
        )
    except ValueError as error:
        raise InputError(
            f"MuJoCo refuses the model ({shown(error, 200)})", file=file, cure="Correct it"
        ) from error
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k) or "" for k in range(model.njnt)]
    if number < 0:
        raise missing(joint, names, file)
    kind = checked_kind(joint, _KINDS[int(model.jnt_type[number])], file)
    dof, place = int(model.jnt_dofadr[number]), int(model.jnt_qposadr[number])
    armature = float(model.dof_armature[dof])
    data = mujoco.MjData(model)

    def opposing(position: float) -> float:
        """The force of gravity on the joint at a position, as the equation of motion has it."""
        data.qpos[:] = model.qpos0
        data.qpos[place] = position
        mujoco.mj_forward(model, data)
        return float(data.qfrc_bias[dof])

    at_zero = opposing(0.0)
    load = {"sine": opposing(np.pi / 2), "cosine": at_zero} if kind == "hinge" else {"constant": at_zero}
    opposing(float(model.qpos0[place]))
    along, inertia = np.zeros(model.nv), np.zeros(model.nv)
    along[dof] = 1.0
    mujoco.mj_mulM(model, data, inertia, along)
    others = [
        names[k]
        for k in range(model.njnt)
        if k != number and _is_behind(model, int(model.jnt_bodyid[k]), int(model.jnt_bodyid[number]))
    ]
    read = plain or JointText(joint, kind)
    return dataclasses.replace(
        read,
        kind=kind,
        armature=armature,
        damping=float(np.ravel(model.dof_damping[dof])[0]),
        frictionloss=float(model.dof_frictionloss[dof]),
        stiffness=float(np.ravel(model.jnt_stiffness[number])[0]),
        rest=float(model.qpos_spring[place]),
        load=JointLoad(float(inertia[dof]) - armature, **load),
        remarks=(*dict.fromkeys((*read.remarks, *held(others))),),
    )


def _is_behind(model: Any, body: int, first: int) -> bool:
    while body > first:
        body = int(model.body_parentid[body])
    return body == first
