"""A drive for MuJoCo: the joint and the actuators in MJCF, and what MuJoCo cannot represent.

MuJoCo itself is not needed here. Its `frictionloss` is Coulomb friction alone, in any version; from version 4.0 its
`dcmotor` actuator has the LuGre bristle of equations (1) and (2), with the same Stribeck curve.
"""

import math
from collections import defaultdict
from typing import Literal
from xml.sax.saxutils import quoteattr

import equinox as eqx
import numpy as np

from frictionjax.core import InputError, Parameter
from frictionjax.estimation import FitResult
from frictionjax.estimation.parameters import effect_layout
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect
from frictionjax.physics.effects.return_spring import ReturnSpring

_STEP = (
    0.1  # of the faster time scale of the bristle: 1 % in presliding, below 0.5 % of the travel in sliding
)
_LEAST_BODY, _LEAST_INERTIA = 1e-9, 1e-14  # of J, and at all: MuJoCo wants a moving body to have some inertia
_BODY_SLACK = 1e-12  # of J: what rounding may leave of a body that has all the inertia
_BRISTLE = ("sigma0", "sigma1", "Fc", "Fs", "vs")  # the numbers of `lugre`, in MuJoCo's order
_LIGHT = 0.1  # of J: a body that is lighter loses the frictionloss of a slide
_LIGHT_BODY = (
    "The frictionloss itself is lost: MuJoCo softens that of a slide by the mass of the body, whatever the armature. "
    "Give the body more of the mass, by `body_inertia`."
)

Kind = Literal["hinge", "slide"]


class MujocoJoint(eqx.Module):
    """A drive as text for MuJoCo.

    **Attributes:**

    - `joint`: the `<joint>` element, for the body that moves; it sets no axis (MuJoCo's default is z).
    - `actuators`: elements for `<actuator>`: the motor, whose control is the input of the drive, and for LuGre the
        passive dcmotor.
    - `lost`: sentences on what the drive has and MuJoCo's model cannot represent.
    - `timestep`: the largest time step advised, s: a tenth of the faster time scale of the sticking bristle
        (infinite where there is no bristle); a bristle without damping needs less.
    - `kind`: `"hinge"` or `"slide"`.
    - `body_inertia`: inertia of the body itself about the joint (hinge) or its mass (slide), in units of J.
    - `trial_inertia`: what `mjcf` gives to the body, in units of J.
    - `stderr`: of a fit, name -> standard error of `armature`, `body_inertia`, `damping`, `gear`, of `stiffness` and
        `frictionloss` where there are any, and of the numbers in `lugre` by their symbols, each in its own unit;
        `inf` where the data do not determine it, 0 for what was not free in the fit. Empty for a drive.
    """

    joint: str = eqx.field(static=True)
    actuators: tuple[str, ...] = eqx.field(static=True)
    lost: tuple[str, ...] = eqx.field(static=True)
    timestep: float = eqx.field(static=True)
    kind: Kind = eqx.field(static=True)
    body_inertia: float = eqx.field(static=True)
    trial_inertia: float = eqx.field(static=True)
    stderr: dict[str, float] = eqx.field(static=True)

    def mjcf(self, timestep: float | None = None) -> str:
        """A complete model with this joint alone, without gravity, to try or to copy from.

        **Arguments:**

        - `timestep`: of the simulation, s; None: the advised one, at most 1 ms.

        **Returns:**

        MJCF as text. The integrator is Euler, whose damping is implicit; RK4 is closer to the solution still,
        implicitfast farther from it (ten times and more in sliding, tests/exchange/test_mujoco.py).
        """
        step = min(self.timestep, 1e-3) if timestep is None else timestep
        m = _text(self.trial_inertia)
        actuators = "\n    ".join(self.actuators)
        return f"""<mujoco>
  <option timestep="{_text(step)}" integrator="Euler" gravity="0 0 0"/>
  <worldbody>
    <body>
      <inertial pos="0 0 0" mass="{m}" diaginertia="{m} {m} {m}"/>
      {self.joint}
    </body>
  </worldbody>
  <actuator>
    {actuators}
  </actuator>
</mujoco>
"""


def mujoco_joint(
    drive: Drive | FitResult,
    *,
    kind: Kind = "hinge",
    name: str = "joint",
    friction: Literal["lugre", "frictionloss"] = "lugre",
    body_inertia: float | int | None = None,
) -> MujocoJoint:
    """The joint and the actuators that behave like `drive` in MuJoCo.

    J becomes armature and body, sigma2 damping, motor_constant the gear of a motor; a return spring becomes
    stiffness. Friction is a passive dcmotor with LuGre (MuJoCo 4.0 or newer), or frictionloss = Fc.

    **Arguments:**

    - `drive`: scalar parameters, in the units of the MuJoCo model: N m and rad for a hinge, N and m for a slide, as a
        rule. Nothing is converted. Or what `fit` found, also one that was read from a file: its drive, with standard
        errors by the delta method from its `covariance`.
    - `kind`: `"hinge"` or `"slide"`.
    - `name`: of the joint; the actuators are called after it.
    - `friction`: `"lugre"` or `"frictionloss"`.
    - `body_inertia`: the part of J assigned to the body itself: inertia about the joint (hinge) or mass (slide),
        in units of J. The rest is armature. None: zero for a hinge, J for a slide.

    **Returns:**

    A `MujocoJoint`, whose `lost` lists what was left out.

    **Raises:**

    `ValueError` for an unknown `kind` or `friction`, or for arrays in place of numbers; `InputError` for parameters
    that MuJoCo cannot take, and for a body with more inertia than J.
    """
    if kind not in ("hinge", "slide"):
        raise ValueError(f'`kind` is {kind!r}; it must be "hinge" or "slide".')
    if friction not in ("lugre", "frictionloss"):
        raise ValueError(f'`friction` is {friction!r}; it must be "lugre" or "frictionloss".')
    result, drive = (drive, drive.drive) if isinstance(drive, FitResult) else (None, drive)
    lugre = friction == "lugre"
    values = _numbers(drive, lugre)
    J = values["J"]
    body_has_all = body_inertia is None and kind == "slide"
    if body_inertia is None:
        body_inertia = J if body_has_all else 0.0
    if not 0.0 <= body_inertia <= (1.0 + _BODY_SLACK) * J:
        raise InputError(
            f"`body_inertia` is {body_inertia:g}; it must lie between 0 and J = {J:g}",
            cure="J is the inertia of body and motor together",
        )
    springs = [effect for effect in drive.effects if isinstance(effect, ReturnSpring)]
    stiffness = sum(float(spring.stiffness) for spring in springs)
    attributes = {
        "name": name,
        "type": kind,
        "armature": _text(max(J - body_inertia, 0.0)),
        "damping": _text(values["sigma2"]),
    }
    if stiffness:
        attributes["stiffness"] = _text(stiffness)
    if not lugre:
        attributes["frictionloss"] = _text(values["Fc"])
    motor = {"name": f"{name}_motor", "joint": name, "gear": _text(values["motor_constant"])}
    actuators = [_element("motor", motor)]
    if lugre:
        bristle = " ".join(_text(values[key]) for key in _BRISTLE)
        dcmotor = {"name": f"{name}_friction", "joint": name, "input": "none", "motorconst": "0"}
        actuators.append(_element("dcmotor", dcmotor | {"resistance": "1", "lugre": bristle}))
    lost = () if lugre else _lost_friction(values)
    if not lugre and kind == "slide" and body_inertia < _LIGHT * J:
        lost += (_LIGHT_BODY,)
    rest = tuple(effect for effect in drive.effects if not isinstance(effect, ReturnSpring))
    return MujocoJoint(
        joint=_element("joint", attributes),
        actuators=tuple(actuators),
        lost=(*lost, *(_lost(effect) for effect in rest if _acts(effect))),
        timestep=_STEP * _fastest(values) if lugre else math.inf,
        kind=kind,
        body_inertia=float(body_inertia),
        trial_inertia=max(float(body_inertia), _LEAST_BODY * J, _LEAST_INERTIA),
        stderr={} if result is None else _stderrs(result, lugre=lugre, body_has_all=body_has_all),
    )


def _stderrs(result: FitResult, *, lugre: bool, body_has_all: bool) -> dict[str, float]:
    """Standard errors of what `MujocoJoint` writes, by name: all of it is a sum of parameters."""
    sums = {"armature": [] if body_has_all else ["J"], "body_inertia": ["J"] if body_has_all else []}
    sums |= {"damping": ["sigma2"], "gear": ["motor_constant"]}
    effects = result.drive.effects
    springs = [f"effects.{i}.stiffness" for i, one in enumerate(effects) if isinstance(one, ReturnSpring)]
    if springs:
        labels = {one.path: one.label for one in effect_layout(result.drive, defaultdict(float))}
        sums["stiffness"] = [labels[path] for path in springs]
    sums |= {name: [name] for name in _BRISTLE} if lugre else {"frictionloss": ["Fc"]}
    return {name: _stderr(result, labels) for name, labels in sums.items()}


def _stderr(result: FitResult, labels: list[str]) -> float:
    """Standard error of the sum of the parameters `labels`; what was not free is known."""
    found = result.stderr
    if any(math.isinf(found.get(label, 0.0)) for label in labels):
        return math.inf
    free = [result.names.index(label) for label in labels if label in result.names]
    # The correlation of a tied parameter with the others is not in a file: this is the bound over all correlations.
    tied = sum(found[label] for label in labels if label in found and label not in result.names)
    return math.sqrt(max(float(np.sum(result.covariance[np.ix_(free, free)])), 0.0)) + tied


def _numbers(drive: Drive, lugre: bool) -> dict[str, float]:
    """The base parameters by name, checked: divisors must be positive."""
    numbers = {"J": drive.J, "motor_constant": drive.motor_constant}
    numbers |= {p.name: getattr(drive.friction, p.name) for p in drive.friction.parameters}
    arrays = [key for key, value in numbers.items() if np.ndim(value)]
    arrays += [e.name for e in drive.effects for p in _parameters(e) if np.ndim(getattr(e, p.name))]
    if arrays:
        raise ValueError(
            f"`drive` has arrays as parameters ({', '.join(arrays)}); MuJoCo takes one drive at a time."
        )
    values = {key: float(value) for key, value in numbers.items()}
    positive = {"J", "Fc"} | ({"sigma0", "Fs", "vs"} if lugre else set())
    for key, value in values.items():
        free = key == "motor_constant"
        if not math.isfinite(value) or (not free and value < 0.0) or (key in positive and value == 0.0):
            must = "be finite" if free else "be positive" if key in positive else "not be negative"
            raise InputError(f"`drive` has {key} = {value:g}; for MuJoCo it must {must}", cure="Fit it again")
    return values


def _fastest(values: dict[str, float]) -> float:
    """The faster time scale of the sticking bristle, s: of its spring or of its damping."""
    J, damping = values["J"], values["sigma1"] + values["sigma2"]
    return min(math.sqrt(J / values["sigma0"]), J / damping if damping else math.inf)


def _lost_friction(values: dict[str, float]) -> tuple[str, ...]:
    """What frictionloss cannot represent."""
    return (
        f"Presliding is lost: the bristle (sigma0 = {values['sigma0']:.6g}, sigma1 = {values['sigma1']:.6g}) is a "
        "constraint of MuJoCo's solver, which creeps under a force below break-away.",
        f"The Stribeck effect is lost: friction is Fc = {values['Fc']:.6g} at every speed, without the rise to "
        f"Fs = {values['Fs']:.6g} below vs = {values['vs']:.6g}; stick-slip will not show.",
    )


def _parameters(effect: AbstractEffect) -> tuple[Parameter, ...]:
    return effect.strengths + effect.nuisances


def _acts(effect: AbstractEffect) -> bool:
    return any(float(getattr(effect, parameter.name)) != 0.0 for parameter in effect.strengths)


def _lost(effect: AbstractEffect) -> str:
    numbers = ", ".join(f"{p.name} = {float(getattr(effect, p.name)):.6g}" for p in _parameters(effect))
    return f"The effect {effect.name} is lost: {effect.about.sentence}, {effect.about.equation} ({numbers})."


def _element(tag: str, attributes: dict[str, str]) -> str:
    return f"<{tag} {' '.join(f'{key}={quoteattr(value)}' for key, value in attributes.items())}/>"


def _text(value: float) -> str:
    """A number that reads back to the last bit."""
    return repr(float(value))
