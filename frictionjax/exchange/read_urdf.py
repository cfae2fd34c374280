"""A joint of a URDF model: its `dynamics`, and the links behind it. Newton and MuJoCo read the same tags."""

from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from frictionjax.core import InputError
from frictionjax.exchange.joint_text import JointText, held
from frictionjax.exchange.rigid import Body, Pose, load_of, roll_pitch_yaw, still, symmetric
from frictionjax.exchange.xml_file import numbers, one
from frictionjax.recordings.words import listed

_KINDS: dict[str, Literal["hinge", "slide"]] = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
}
_GRAVITY = np.array([0.0, 0.0, -9.81])


def read_urdf(root: Element, joint: str, file: Path | None) -> JointText:
    """The numbers of one joint.

    **Arguments:**

    - `root`: the `<robot>`.
    - `joint`: its name.
    - `file`: for messages.

    **Raises:** `InputError` where the joint is not there, or does not turn or slide.
    """
    joints = {found.get("name", ""): found for found in root.findall("joint")}
    if joint not in joints:
        known = listed([name for name, found in joints.items() if found.get("type") in _KINDS])
        raise InputError(
            f'there is no joint "{joint}"', file=file, place="`joint`", cure=f"Its joints: {known}"
        )
    element = joints[joint]
    kind = _KINDS.get(element.get("type", ""))
    if kind is None:
        raise InputError(
            f'the joint "{joint}" is {element.get("type")}',
            file=file,
            place="`joint`",
            cure="Choose one that is revolute, continuous or prismatic",
        )
    dynamics = element.find("dynamics")
    values = {} if dynamics is None else dynamics.attrib
    pose = _to_root(joints, _link(element, "parent")).then(_origin(element))
    axis_element = element.find("axis")
    axis = numbers(None if axis_element is None else axis_element.get("xyz"), "1 0 0", f"{joint}, axis")
    bodies, others = _behind(root, joints, _link(element, "child"), pose)
    turned = pose.turn @ (axis / np.linalg.norm(axis))
    load = load_of(
        bodies, axis=turned, anchor=pose.origin, gravity=_GRAVITY, hinge=kind == "hinge", reference=0.0
    )
    return JointText(
        joint,
        kind,
        damping=one(values.get("damping"), 0.0, f"{joint}, damping"),
        frictionloss=one(values.get("friction"), 0.0, f"{joint}, friction"),
        load=load,
        remarks=("URDF has no place for the inertia of the rotor.", *held(others)),
    )


def _link(joint: Element, role: str) -> str:
    found = joint.find(role)
    return "" if found is None else found.get("link", "")


def _origin(element: Element) -> Pose:
    origin = element.find("origin")
    if origin is None:
        return still()
    where = f"{element.get('name', element.tag)}, origin"
    return Pose(
        numbers(origin.get("xyz"), "0 0 0", where),
        roll_pitch_yaw(numbers(origin.get("rpy"), "0 0 0", where)),
    )


def _to_root(joints: dict[str, Element], link: str) -> Pose:
    """The pose of a `link` in the root of the robot, all joints at zero."""
    pose, seen = still(), set()
    above = {_link(found, "child"): found for found in joints.values()}
    while link in above and link not in seen:
        seen.add(link)
        pose = _origin(above[link]).then(pose)
        link = _link(above[link], "parent")
    return pose


def _behind(root: Element, joints: dict[str, Element], link: str, pose: Pose) -> tuple[list[Body], list[str]]:
    """The bodies that move with a `link` at `pose`, and the names of the joints among them that are taken as locked."""
    links = {found.get("name"): found for found in root.findall("link")}
    found, locked, left, seen = [], [], [(link, pose)], set()
    while left:
        name, place = left.pop()
        if name in seen:
            continue
        seen.add(name)
        inertial = links[name].find("inertial") if name in links else None
        if inertial is not None:
            found.append(_body(inertial, str(name)).seen_from(place.then(_origin(inertial))))
        for label, further in joints.items():
            if _link(further, "parent") == name:
                left.append((_link(further, "child"), place.then(_origin(further))))
                locked += [label] if further.get("type") != "fixed" else []
    return found, locked


def _body(inertial: Element, link: str) -> Body:
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    parts = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = [0.0 if inertia is None else one(inertia.get(part), 0.0, f"{link}, {part}") for part in parts]
    weight = 0.0 if mass is None else one(mass.get("value"), 0.0, f"{link}, mass")
    return Body(weight, np.zeros(3), symmetric(*values))
