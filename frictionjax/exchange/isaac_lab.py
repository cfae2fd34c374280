"""A drive for Isaac Lab: an actuator whose joint has static, dynamic and viscous friction."""

from collections.abc import Sequence

from frictionjax.core import InputError
from frictionjax.estimation import FitResult
from frictionjax.exchange.joint import (
    JointModel,
    exact,
    lost_effects,
    lost_motor,
    lost_presliding,
    numbers_of,
    parts_of,
    stderr_of_sum,
)
from frictionjax.physics import Drive

_HOLDS = "is a joint that holds still below break-away."


def isaac_lab_actuator(
    drive: Drive | FitResult,
    *,
    joints: Sequence[str] = ("joint",),
    body_inertia: float = 0.0,
    stiffness: float = 0.0,
    damping: float = 0.0,
) -> JointModel:
    """An `ImplicitActuatorCfg` of Isaac Lab as Python text: armature, static, dynamic and viscous friction of a joint.

    `friction` is Fs and `dynamic_friction` is Fc, efforts as from Isaac Sim 5.0 on; before, they were coefficients of
    another model, and the text does not hold.

    **Arguments:**

    - `drive`: scalar parameters in N m and rad, or N and m; nothing is converted. Or what `fit` found, with standard
        errors.
    - `joints`: names of the joints, or regular expressions for them.
    - `body_inertia`: the part of J that the links already have, in units of J; the rest is armature.
    - `stiffness`, `damping`: gains of the position controller inside the simulator, force/position and
        force s/position; with zeros the input is an effort.

    **Returns:**

    A `JointModel`, whose `lost` lists what was left out.

    **Raises:**

    `ValueError` for arrays in place of numbers; `InputError` for parameters that Isaac Lab cannot take, a body with
    more inertia than J, and static friction below dynamic friction.
    """
    result, drive = parts_of(drive)
    values = numbers_of(drive, {"J", "Fc", "Fs"}, "Isaac Lab")
    if not 0.0 <= body_inertia <= values["J"]:
        raise InputError(
            f"`body_inertia` is {body_inertia:g}; it must lie between 0 and J = {values['J']:g}",
            cure="J is the inertia of body and motor together",
        )
    if values["Fs"] < values["Fc"]:
        raise InputError(
            f"`drive` has Fs = {values['Fs']:g} below Fc = {values['Fc']:g}; for Isaac Lab it must not be lower",
            cure="Fit it again with the bound Fs >= Fc",
        )
    written = {
        "stiffness": float(stiffness),
        "damping": float(damping),
        "armature": values["J"] - body_inertia,
        "friction": values["Fs"],
        "dynamic_friction": values["Fc"],
        "viscous_friction": values["sigma2"],
    }
    lines = "".join(f"    {name}={exact(value)},\n" for name, value in written.items())
    lost = (
        lost_presliding(values, _HOLDS),
        f"The Stribeck curve is lost: friction drops from Fs = {values['Fs']:.6g} to Fc = {values['Fc']:.6g} as soon "
        f"as the joint moves, not over vs = {values['vs']:.6g}; stick-slip comes too easily.",
        *lost_motor(values),
        *lost_effects(drive),
    )
    sources = {"armature": "J", "friction": "Fs", "dynamic_friction": "Fc", "viscous_friction": "sigma2"}
    return JointModel(
        text=f"ImplicitActuatorCfg(\n    joint_names_expr={list(joints)!r},\n{lines})\n",
        values=written,
        lost=lost,
        stderr={}
        if result is None
        else {name: stderr_of_sum(result, {label: 1.0}) for name, label in sources.items()},
    )
