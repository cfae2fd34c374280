"""A drive for URDF: the element `dynamics` of a joint."""

from typing import Literal

from frictionjax.estimation import FitResult
from frictionjax.exchange.joint import (
    JointModel,
    element,
    exact,
    lost_effects,
    lost_motor,
    lost_presliding,
    lost_stribeck,
    numbers_of,
    parts_of,
    stderr_of_sum,
)
from frictionjax.physics import Drive


def urdf_dynamics(drive: Drive | FitResult, *, friction: Literal["Fc", "Fs"] = "Fc") -> JointModel:
    """The element `<dynamics damping="..." friction="..."/>` of a URDF joint: damping is sigma2, friction a constant.

    **Arguments:**

    - `drive`: scalar parameters in N m and rad for a revolute joint, N and m for a prismatic one; nothing is converted.
        Or what `fit` found, with standard errors.
    - `friction`: which level becomes the constant: `"Fc"` (right in sliding) or `"Fs"` (right where it breaks away).

    **Returns:**

    A `JointModel`, whose `lost` lists what was left out, the inertia among it: in URDF that belongs to the link.

    **Raises:**

    `ValueError` for another `friction`, or for arrays in place of numbers; `InputError` for parameters that URDF cannot
    take.
    """
    if friction not in ("Fc", "Fs"):
        raise ValueError(f'`friction` is {friction!r}; it must be "Fc" or "Fs".')
    result, drive = parts_of(drive)
    values = numbers_of(drive, {"J", "Fc", "Fs"}, "URDF")
    written = {"damping": values["sigma2"], "friction": values[friction]}
    lost = (
        f"The inertia is lost: add J = {values['J']:.6g} about the axis to the inertial element of the moving link.",
        lost_presliding(values, "has no place in URDF."),
        lost_stribeck(values, friction),
        *lost_motor(values),
        *lost_effects(drive),
    )
    return JointModel(
        text=element("dynamics", {name: exact(value) for name, value in written.items()}),
        values=written,
        lost=lost,
        stderr={}
        if result is None
        else {
            "damping": stderr_of_sum(result, {"sigma2": 1.0}),
            "friction": stderr_of_sum(result, {friction: 1.0}),
        },
    )
