"""A robot's model, MJCF or URDF, compiled by MuJoCo, as rigid bodies on the joints of a log."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, tostring

import numpy as np
from jaxtyping import Float

from frictionjax.arm.rigid_body import RigidBody
from frictionjax.core import InputError
from frictionjax.exchange.joint_text import INSTALL
from frictionjax.exchange.rigid import rotation
from frictionjax.exchange.xml_file import read_xml
from frictionjax.recordings.readers.extra import optional
from frictionjax.recordings.words import listed, nearest, shown

_SLIDE, _HINGE = 2, 3  # mjtJoint
_TIED = 2  # mjtEq: one joint follows another; all others tie bodies together


class Robot(NamedTuple):
    """A model that MuJoCo compiled: `mujoco` (the library), `model`, the names of all `joints`, those of hinges and
    slides, `movable`, and the `file` that it came from, None for text."""

    mujoco: Any
    model: Any
    joints: tuple[str, ...]
    movable: tuple[str, ...]
    file: Path | None


def read_robot(model: str | Path) -> Robot:
    """Compile a robot's model.

    **Arguments:**

    - `model`: a MuJoCo or URDF model: the path of the file, or its text.

    **Raises:** `InputError` where MuJoCo is not installed, and for a file that is no model of a robot with joints.
    """
    mujoco: Any = optional("mujoco")
    root, text, file = read_xml(model)
    if root.tag not in ("mujoco", "robot"):
        raise InputError(
            f"begins with <{shown(root.tag, 40)}>, which is no robot",
            file=file,
            cure="Give a MuJoCo model, which begins with <mujoco>, or a URDF one, with <robot>",
        )
    if mujoco is None:
        raise InputError(
            "a model of many joints is read by MuJoCo, which is not installed",
            file=file,
            cure=f"Run {INSTALL}",
        )
    try:
        compiled = _compiled(mujoco, root, text, file)
    except ValueError as error:
        raise InputError(
            f"MuJoCo refuses the model ({shown(error, 200)})", file=file, cure="Correct it"
        ) from error
    names = tuple(
        mujoco.mj_id2name(compiled, mujoco.mjtObj.mjOBJ_JOINT, k) or f"joint_{k}"
        for k in range(compiled.njnt)
    )
    movable = tuple(
        name for name, kind in zip(names, compiled.jnt_type, strict=True) if int(kind) in (_SLIDE, _HINGE)
    )
    if not movable:
        raise InputError("has no hinge and no slide", file=file, cure="Give the model of a robot with joints")
    return Robot(mujoco, compiled, names, movable, file)


def _compiled(mujoco: Any, root: Element, text: str, file: Path | None) -> Any:
    if root.tag == "mujoco":
        return (
            mujoco.MjModel.from_xml_string(text) if file is None else mujoco.MjModel.from_xml_path(str(file))
        )
    # A URDF link states its inertia: what it looks like, in files that may lie elsewhere, is not needed.
    for link in root.iter("link"):
        for shape in [part for part in link if part.tag in ("visual", "collision")]:
            link.remove(shape)
    return mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))


def rigid_body(robot: Robot, joints: Sequence[str] = ()) -> RigidBody:
    """The rigid bodies of a `robot` that move with some of its joints.

    Joints that are not asked for are held where the model has them at first. Damping, friction and springs of the
    joints are no part of rigid bodies, and are left out.

    **Arguments:**

    - `robot`: what `read_robot` compiled.
    - `joints`: names of hinges and slides, in the order of the log; empty: all of them, in the order of the model.

    **Raises:** `InputError` for a joint that is not in the model, and for joints that are tied to others.
    """
    mujoco, model, names, movable, file = robot
    wanted = list(joints or movable)
    for name in wanted:
        if name not in movable:
            near = nearest(name, movable)
            hint = f"Did you mean `{shown(near)}`? " if near else ""
            raise InputError(
                f"there is no joint `{shown(name)}`",
                file=file,
                place="`joints`",
                cure=f"{hint}The model has the hinges and slides: {listed(movable)}",
            )
        if wanted.count(name) > 1:
            raise InputError(f"`{shown(name)}` is given twice", place="`joints`", cure="Name each joint once")
    kinds, chosen = model.jnt_type, [names.index(name) for name in wanted]
    _require_free(model, chosen, names, file)
    parents = [int(parent) for parent in model.body_parentid]
    mounts = {int(model.jnt_bodyid[k]) for k in chosen}
    moving = [body for body in range(model.nbody) if _chain(parents, body) & mounts]
    # What stands between a body and the nearest one that moves does not move in it: poses are put together.
    place, turn, parent = [], [], []
    for body in moving:
        pose = np.eye(4)
        link = body
        while True:
            pose = _pose(model.body_pos[link], model.body_quat[link]) @ pose
            link = parents[link]
            if link == 0 or link in moving:
                break
        place.append(pose[:3, 3])
        turn.append(pose[:3, :3])
        parent.append(moving.index(link) if link in moving else -1)
    bodies = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b) or f"body_{b}" for b in moving]
    return RigidBody(
        joints=tuple(wanted),
        hinge=np.array([int(kinds[k]) == _HINGE for k in chosen]),
        bodies=tuple(bodies),
        parent=np.array(parent),
        place=np.array(place),
        turn=np.array(turn),
        carried_by=np.array([moving.index(int(model.jnt_bodyid[k])) for k in chosen]),
        sequence=np.array(chosen),
        anchor=np.array([model.jnt_pos[k] for k in chosen]),
        axis=np.array([model.jnt_axis[k] for k in chosen]),
        reference=np.array([model.qpos0[model.jnt_qposadr[k]] for k in chosen]),
        gravity=np.array(model.opt.gravity),
        inertial=np.array([_inertial(model, body) for body in moving]),
        armature=np.array([model.dof_armature[model.jnt_dofadr[k]] for k in chosen]),
    )


def _require_free(model: Any, chosen: list[int], names: Sequence[str], file: Path | None) -> None:
    """Raise `InputError` where a joint of the log is tied to another one, or bodies close a loop: then the torque of a
    joint is not what its own bodies take."""
    for k in range(model.neq):
        tied = int(model.eq_type[k]) == _TIED
        ends = [int(model.eq_obj1id[k]), int(model.eq_obj2id[k])]
        held = [names[j] for j in ends if j in chosen]
        if not tied or held:
            what = f"ties the joint `{shown(held[0])}` to another one" if tied else "closes a loop of bodies"
            raise InputError(
                f"an equality constraint {what}, and the torques of such joints are not separate",
                file=file,
                cure="Remove <equality> from the model, or leave tied joints out of the log",
            )


def _chain(parents: list[int], body: int) -> set[int]:
    """The `body` and all between it and the world."""
    found = set()
    while body:
        found.add(body)
        body = parents[body]
    return found


def _pose(place: Float[np.ndarray, " 3"], quaternion: Float[np.ndarray, " 4"]) -> Float[np.ndarray, "4 4"]:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = rotation(np.asarray(quaternion)), place
    return found


def _inertial(model: Any, body: int) -> Float[np.ndarray, " 10"]:
    """Mass, mass times centre, and inertia about the origin of a body, in its own frame."""
    mass, centre = float(model.body_mass[body]), np.asarray(model.body_ipos[body])
    turn = rotation(np.asarray(model.body_iquat[body]))
    about_centre = turn @ np.diag(model.body_inertia[body]) @ turn.T
    inertia = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    upper = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return np.concatenate([[mass], mass * centre, upper])
