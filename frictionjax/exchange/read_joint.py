"""`read_mujoco_joint`: the model of a joint that a robot's XML file holds, as the base of a diagnosis."""

import dataclasses
import math
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import equinox as eqx

from frictionjax.core import InputError
from frictionjax.exchange.compile_mjcf import compile_mjcf
from frictionjax.exchange.joint_text import JointText
from frictionjax.exchange.read_mjcf import NeedsCompiler, read_mjcf
from frictionjax.exchange.read_urdf import read_urdf
from frictionjax.exchange.xml_file import read_xml
from frictionjax.recordings import Case, Given, GivenEffect, GivenModel, Plant
from frictionjax.recordings.words import shown

_SAME = 1e-6  # relative difference of two motor constants that are meant to be one


class KnownJoint(eqx.Module):
    """What a robot's XML file knows of one joint, as the base model of a diagnosis.

    **Attributes:**

    - `name`, `kind`: of the joint, `"hinge"` or `"slide"`.
    - `model`: parameters and effects that the file gives, as `[model]` of a case file has them.
    - `plant`: units (rad and N m, or m and N), and the motor constant.
    - `remarks`: sentences on what the file does not say, or what was not read.
    """

    name: str = eqx.field(static=True)
    kind: Literal["hinge", "slide"] = eqx.field(static=True)
    model: GivenModel
    plant: Plant
    remarks: tuple[str, ...] = eqx.field(static=True, default=())

    def in_case(self, case: Case) -> Case:
        """The `case` with this joint as its base model; its motor constant, where the case has none.

        **Raises:** `InputError` for a case with a model or another motor constant of its own.
        """
        if case.model is not None:
            raise InputError(
                "has a base model already", file=case.name, place="[model]", cure="Leave one of them out"
            )
        constant = case.plant.motor_constant
        if constant is None:
            plant = dataclasses.replace(case.plant, motor_constant=self.plant.motor_constant)
        else:
            if not math.isclose(constant, self.plant.motor_constant or 1.0, rel_tol=_SAME):
                raise InputError(
                    f"has the motor constant {constant:g}, and the motor of {self.name} {self.plant.motor_constant:g}",
                    file=case.name,
                    place="motor_constant",
                    cure="Leave it out of the case, or correct the gear of the motor",
                )
            plant = case.plant
        return dataclasses.replace(case, plant=plant, model=self.model)

    def toml(self) -> str:
        """The same as the lines of a case file."""
        values = ", ".join(f"{name} = {_toml(one)}" for name, one in self.model.parameters.items())
        effects = ", ".join(
            f'{{name = "{effect.name}"{"".join(f", {key} = {_toml(one)}" for key, one in effect.values.items())}}}'
            for effect in self.model.effects
        )
        lines = ["[model]", f"parameters = {{{values}}}", f"effects = [{effects}]"]
        return "\n".join(lines) + "\n"


def read_mujoco_joint(xml: str | Path, joint: str, *, fixed: bool = False) -> KnownJoint:
    """The base model that a MuJoCo or URDF model has of one joint, to ask a diagnosis what it leaves out.

    Armature and the bodies behind the joint become J, damping sigma2, frictionloss (URDF: friction) Fc, a spring and
    gravity effects; MuJoCo's LuGre actuator gives the other parameters of friction. Bodies made of shapes need the
    package mujoco; all else is read without it. Newton reads the same tags of both formats.

    **Arguments:**

    - `xml`: the path of the file, or its text.
    - `joint`: the name of the joint, a hinge or a slide.
    - `fixed`: whether a fit leaves all values as they are; else it starts from them.

    **Returns:** the `KnownJoint`; `known.in_case(case)` is what `diagnose` takes.

    **Raises:** `InputError` for a file that is missing, is not such a model, or has no such joint.
    """
    root, text, file = read_xml(xml)
    if root.tag == "robot":
        read = read_urdf(root, joint, file)
    elif root.tag == "mujoco":
        read = _mujoco(root, text, file, joint)
    else:
        raise InputError(
            f"begins with <{shown(root.tag, 40)}>, which is no robot",
            file=file,
            cure="Give a MuJoCo model, which begins with <mujoco>, or a URDF one, with <robot>",
        )
    return _known(read, fixed)


def _mujoco(root: Element, text: str, file: Path | None, joint: str) -> JointText:
    try:
        read = read_mjcf(root, joint, file)
    except NeedsCompiler:
        read = None
    if read is not None and read.load is not None:
        return read
    return compile_mjcf(text, file, joint, read)


def _known(read: JointText, fixed: bool) -> KnownJoint:
    load = read.load
    inertia = read.armature + (0.0 if load is None else load.inertia)
    values = {"J": inertia, "sigma2": read.damping, "Fc": read.frictionloss} | read.bristle
    # A parameter without a size is not given: in the logarithm of a fit it would have none.
    parameters = {name: Given(value, fixed) for name, value in values.items() if value > 0.0}
    sizes = {"gravity_pendulum": {}, "return_spring": {"stiffness": read.stiffness}, "constant_load": {}}
    steady = -read.stiffness * read.rest
    if load is not None:
        sizes["gravity_pendulum"] = {"sine": load.sine, "cosine": load.cosine}
        steady += load.constant
    sizes["constant_load"] = {"load": steady}
    effects = tuple(
        GivenEffect(name, values={key: Given(size, fixed) for key, size in own.items()})
        for name, own in sizes.items()
        if any(abs(size) > _noise_of(read) for size in own.values())
    )
    unit = {"hinge": ("rad", "N*m"), "slide": ("m", "N")}[read.kind]
    plant = Plant(read.gear, unit[0], unit[1], unit[1] if read.gear == 1.0 else "input")
    unsaid = [name for name in ("J", "sigma2", "Fc") if name not in parameters]
    remarks = read.remarks
    if unsaid:
        remarks += (f"The model gives no {' and no '.join(unsaid)}: the recordings decide.",)
    if not read.bristle:
        remarks += ("The model has no presliding and no Stribeck effect: the recordings decide.",)
    return KnownJoint(read.name, read.kind, GivenModel(parameters, effects), plant, remarks)


def _noise_of(read: JointText) -> float:
    """What rounding leaves of a force that is zero: of an arm at right angles to gravity."""
    load = read.load
    return 0.0 if load is None else 1e-12 * (abs(load.sine) + abs(load.cosine) + abs(load.constant))


def _toml(given: Given) -> str:
    return f"{{value = {given.value!r}, fixed = true}}" if given.fixed else repr(given.value)
