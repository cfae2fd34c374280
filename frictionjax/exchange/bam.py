"""A drive for BAM (Better Actuator Models, Rhoban): the JSON file of its models m1 and m2.

There the motor obeys torque = kt u/R - kt^2 v/R for a voltage u, and torque = kt u for a current; what our sigma2 has
of the back electromotive force is taken out of the viscous friction.
"""

import json
from typing import Literal

from frictionjax.core import InputError
from frictionjax.estimation import FitResult
from frictionjax.exchange.joint import (
    JointModel,
    lost_effects,
    lost_presliding,
    lost_stribeck,
    numbers_of,
    parts_of,
    stderr_of_sum,
)
from frictionjax.physics import Drive
from frictionjax.physics.effects.stribeck_shape import StribeckShape

_STRIBECK_EXPONENT = 2.0
_STOPS = "is a torque that stops the joint exactly below break-away."


def bam_parameters(
    drive: Drive | FitResult,
    *,
    actuator: str,
    resistance: float,
    control: Literal["volts", "amps"] = "volts",
    model: Literal["m1", "m2"] = "m2",
    body_inertia: float = 0.0,
) -> JointModel:
    """The parameter file of BAM for a `drive`: kt, R, armature, and friction with the Stribeck effect (m2) or without.

    **Arguments:**

    - `drive`: scalar parameters in N m and rad, input in V or A; nothing is converted. Or what `fit` found, with
        standard errors.
    - `actuator`: the name of the actuator in BAM, such as `"mx106"`.
    - `resistance`: of the motor, ohm. It is not identified here: with a voltage as input, the data show kt/R alone.
    - `control`: what the input of the drive is: `"volts"` (Dynamixel) or `"amps"` (eRob).
    - `model`: `"m2"` with the Stribeck effect, `"m1"` with Fc at every speed.
    - `body_inertia`: the part of J that the body has (the pendulum of a bench), in kg m^2; the rest is armature.

    **Returns:**

    A `JointModel` whose `text` is the JSON file, and whose `lost` lists what was left out.

    **Raises:**

    `ValueError` for another `control` or `model`, or for arrays in place of numbers; `InputError` for parameters that
    BAM cannot take: more back electromotive force than sigma2, or a body with more inertia than J.
    """
    if control not in ("volts", "amps"):
        raise ValueError(f'`control` is {control!r}; it must be "volts" or "amps".')
    if model not in ("m1", "m2"):
        raise ValueError(f'`model` is {model!r}; it must be "m1" or "m2".')
    if not resistance > 0.0:
        raise InputError(
            f"`resistance` is {resistance:g}; it must be positive", cure="See the data sheet, in ohm"
        )
    result, drive = parts_of(drive)
    values = numbers_of(drive, {"J", "Fc", "Fs", "vs"}, "BAM")
    if not 0.0 <= body_inertia <= values["J"]:
        raise InputError(
            f"`body_inertia` is {body_inertia:g}; it must lie between 0 and J = {values['J']:g}",
            cure="J is the inertia of body and motor together",
        )
    constant = values["motor_constant"]
    braking = constant**2 * resistance if control == "volts" else 0.0
    if braking > values["sigma2"]:
        raise InputError(
            f"the back electromotive force of this motor alone damps with {braking:.4g} N m s/rad, and the drive has "
            f"sigma2 = {values['sigma2']:.4g}",
            place="`resistance`",
            cure='Check it, or give `control="amps"` if the input is a current',
        )
    written = {
        "kt": constant * resistance if control == "volts" else constant,
        "R": float(resistance),
        "armature": values["J"] - body_inertia,
        "friction_base": values["Fc"],
        "friction_viscous": values["sigma2"] - braking,
    }
    factors = {
        "kt": {"motor_constant": resistance if control == "volts" else 1.0},
        "armature": {"J": 1.0},
        "friction_base": {"Fc": 1.0},
        "friction_viscous": {"sigma2": 1.0}
        | ({"motor_constant": -2.0 * constant * resistance} if control == "volts" else {}),
    }
    lost = [lost_presliding(values, _STOPS)]
    shapes = [effect for effect in drive.effects if isinstance(effect, StribeckShape)]
    if model == "m2":
        written |= {
            "friction_stribeck": values["Fs"] - values["Fc"],
            "dtheta_stribeck": values["vs"],
            "alpha": _STRIBECK_EXPONENT + sum(float(one.exponent_change) for one in shapes),
        }
        factors |= {"friction_stribeck": {"Fs": 1.0, "Fc": -1.0}, "dtheta_stribeck": {"vs": 1.0}}
        factors["alpha"] = {"exponent_change": 1.0} if shapes else {}
    else:
        lost.append(lost_stribeck(values, "Fc"))
    return JointModel(
        text=json.dumps({**written, "model": model, "actuator": actuator}, indent=4) + "\n",
        values=written,
        lost=(*lost, *lost_effects(drive, (StribeckShape,) if model == "m2" else ())),
        stderr={} if result is None else {name: stderr_of_sum(result, by) for name, by in factors.items()},
    )
