"""A joint of a MuJoCo model (MJCF): its own numbers, its motor, and the bodies behind it where they are written out.

What only MuJoCo's compiler knows (inertia that follows from shapes, included files) is asked of MuJoCo.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, cast
from xml.etree.ElementTree import Element

import numpy as np

from frictionjax.core import InputError
from frictionjax.exchange.joint_text import JointText, held
from frictionjax.exchange.rigid import Body, JointLoad, Pose, load_of, rotation, still, symmetric
from frictionjax.exchange.xml_file import numbers, one
from frictionjax.recordings.words import listed

_BRISTLE = ("sigma0", "sigma1", "Fc", "Fs", "vs")  # the numbers of `lugre`, in MuJoCo's order
_TURNED = ("euler", "axisangle", "xyaxes", "zaxis")
_NEEDS_COMPILER = ("include", "frame", "replicate", "attach", "composite", "flexcomp")
_DEFAULT = "main"

Path_ = list[Element]
"""The bodies from the world to one of them, outermost first."""


class NeedsCompiler(Exception):
    """Only MuJoCo's compiler knows what was asked for."""


def read_mjcf(root: Element, joint: str, file: Path | None) -> JointText:
    """The numbers of one joint; its `load` is None where the model must be compiled for it.

    **Arguments:**

    - `root`: the `<mujoco>`.
    - `joint`: its name.
    - `file`: for messages.

    **Raises:** `InputError` where the joint is not there, or does not turn or slide; `NeedsCompiler` where it may be in
    a file that is included.
    """
    defaults = _defaults(root)
    found = {name: (element, path) for name, element, path in _joints(root)}
    if joint not in found:
        if any(next(root.iter(tag), None) is not None for tag in _NEEDS_COMPILER):
            raise NeedsCompiler
        raise missing(joint, list(found), file)
    element, path = found[joint]
    own = _with_defaults(element, path, defaults)
    kind = checked_kind(joint, own.get("type", "hinge"), file)
    degrees = _compiler(root, "angle", "degree") == "degree" and kind == "hinge"
    angle = math.pi / 180.0 if degrees else 1.0

    def value(name: str) -> float:
        return one(own.get(name), 0.0, f"{joint}, {name}")

    others: list[str] = []
    try:
        load = _load(root, element, own, path, kind, angle * value("ref"), others)
    except NeedsCompiler:
        load = None
    gear, bristle, remarks = _actuators(root, joint, defaults)
    polynomial = [
        name
        for name in ("damping", "stiffness")
        if np.any(numbers(own.get(name), "0", f"{joint}, {name}")[1:])
    ]
    remarks += [f"The higher powers of {name} are left out." for name in polynomial]
    return JointText(
        joint,
        kind,
        value("armature"),
        value("damping"),
        value("frictionloss"),
        value("stiffness"),
        angle * value("springref"),
        load,
        gear,
        bristle,
        (*remarks, *held(others)),
    )


def missing(joint: str, known: list[str], file: Path | None) -> InputError:
    """The error for a `joint` that is not among the `known` ones of a `file`."""
    return InputError(
        f'there is no joint "{joint}"', file=file, place="`joint`", cure=f"Its joints: {listed(known)}"
    )


def checked_kind(joint: str, kind: str, file: Path | None) -> Literal["hinge", "slide"]:
    """The `kind` of a `joint`, if it turns or slides; else an `InputError`."""
    if kind not in ("hinge", "slide"):
        raise InputError(
            f'the joint "{joint}" is a {kind} joint',
            file=file,
            place="`joint`",
            cure="Choose a hinge or a slide",
        )
    return cast(Literal["hinge", "slide"], kind)


def _joints(root: Element) -> Iterator[tuple[str, Element, Path_]]:
    """Name, element and bodies above it, of every joint."""
    left: list[tuple[Element, Path_]] = [(world, []) for world in root.findall("worldbody")]
    while left:
        element, path = left.pop(0)
        for child in element.findall("joint"):
            yield child.get("name", ""), child, path
        left += [(body, [*path, body]) for body in element.findall("body")]


def _defaults(root: Element) -> dict[str, dict[str, dict[str, str]]]:
    """Class -> tag -> attributes, what its parents say included."""
    found: dict[str, dict[str, dict[str, str]]] = {}

    def add(element: Element, above: dict[str, dict[str, str]]) -> None:
        own = {tag: dict(values) for tag, values in above.items()}
        for child in element:
            if child.tag != "default":
                own[child.tag] = own.get(child.tag, {}) | child.attrib
        found[element.get("class", _DEFAULT)] = own
        for child in element.findall("default"):
            add(child, own)

    for top in root.findall("default"):
        add(top, {})
    return found


def _with_defaults(
    element: Element, path: Path_, defaults: dict[str, dict[str, dict[str, str]]]
) -> dict[str, str]:
    """The attributes of an element, with those of its class."""
    nearest = next((body.get("childclass") for body in reversed(path) if body.get("childclass")), None)
    name = element.get("class") or nearest or _DEFAULT
    return defaults.get(name, {}).get(element.tag, {}) | element.attrib


def _compiler(root: Element, name: str, default: str) -> str:
    return next((found.attrib[name] for found in root.findall("compiler") if name in found.attrib), default)


def _load(
    root: Element,
    joint: Element,
    own: dict[str, str],
    path: Path_,
    kind: str,
    reference: float,
    others: list[str],
) -> JointLoad:
    """The bodies behind a joint; adds the names of joints that are taken as locked to `others`."""
    option = next((found.get("gravity") for found in root.findall("option") if found.get("gravity")), None)
    shapes = _compiler(root, "inertiafromgeom", "auto") == "true"
    elsewhere = any(next(root.iter(tag), None) is not None for tag in _NEEDS_COMPILER)
    if shapes or elsewhere or _compiler(root, "settotalmass", ""):
        raise NeedsCompiler
    pose = still()
    for body in path:
        pose = pose.then(_pose(body))
    axis = numbers(own.get("axis"), "0 0 1", "axis")
    anchor = pose.origin + pose.turn @ numbers(own.get("pos"), "0 0 0", "pos")
    bodies: list[Body] = []
    left = [(path[-1], pose)] if path else []
    while left:
        body, place = left.pop()
        inertial = body.find("inertial")
        if inertial is not None:
            bodies.append(_body(inertial).seen_from(place.then(_pose(inertial))))
        elif body.find("geom") is not None:
            raise NeedsCompiler
        others += [
            child.get("name", "another joint") for child in body.findall("joint") if child is not joint
        ]
        left += [(child, place.then(_pose(child))) for child in body.findall("body")]
    return load_of(
        bodies,
        axis=pose.turn @ (axis / np.linalg.norm(axis)),
        anchor=anchor,
        gravity=numbers(option, "0 0 -9.81", "gravity"),
        hinge=kind == "hinge",
        reference=reference,
    )


def _pose(element: Element) -> Pose:
    if any(name in element.attrib for name in _TURNED):
        raise NeedsCompiler
    return Pose(
        numbers(element.get("pos"), "0 0 0", f"{element.tag}, pos"),
        rotation(numbers(element.get("quat"), "1 0 0 0", f"{element.tag}, quat")),
    )


def _body(inertial: Element) -> Body:
    full = inertial.get("fullinertia")
    if full is None:
        inertia = np.diag(numbers(inertial.get("diaginertia"), "0 0 0", "diaginertia"))
    else:
        inertia = symmetric(*numbers(full, "", "fullinertia").tolist())
    return Body(one(inertial.get("mass"), 0.0, "mass"), np.zeros(3), inertia)


def _actuators(
    root: Element, joint: str, defaults: dict[str, dict[str, dict[str, str]]]
) -> tuple[float, dict[str, float], list[str]]:
    """Force per unit of the control, the numbers of LuGre, and what is not read, of a joint's actuators."""
    gears, bristle, remarks = [], {}, []
    for element in (child for group in root.findall("actuator") for child in group):
        if element.get("joint") != joint:
            continue
        own = _with_defaults(element, [], defaults)
        name = own.get("name", element.tag)
        if "lugre" in own:
            values = numbers(own["lugre"], "", f"{name}, lugre").tolist()
            bristle = {str(key): value for key, value in zip(_BRISTLE, values, strict=False)}
        elif element.tag == "motor":
            gears.append(one(own.get("gear"), 1.0, f"{name}, gear"))
        else:
            remarks.append(
                f"The actuator {name} is a {element.tag}: its control is no force, so record the force that it makes."
            )
    if len(gears) > 1:
        remarks.append(f"Of {len(gears)} motors on one joint only the first is read.")
    return gears[0] if gears else 1.0, bristle, remarks
