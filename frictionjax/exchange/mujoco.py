"""A drive for MuJoCo: the joint and the actuators in MJCF, and what MuJoCo cannot represent.

MuJoCo itself is not needed here. Its `frictionloss` is Coulomb friction alone, in any version; from version 4.0 its
`dcmotor` actuator has the LuGre bristle of equations (1) and (2), with the same Stribeck curve.
"""

import math
from collections import defaultdict
from typing import Literal

import equinox as eqx

from frictionjax.core import InputError
from frictionjax.estimation import FitResult
from frictionjax.estimation.parameters import effect_layout
from frictionjax.exchange.joint import (
    element,
    exact,
    lost_effects,
    lost_presliding,
    lost_stribeck,
    numbers_of,
    parts_of,
    stderr_of_sum,
)
from frictionjax.physics import Drive
from frictionjax.physics.effects.return_spring import ReturnSpring

_STEP = (
    0.1  # of the faster time scale of the bristle: 1 % in presliding, below 0.5 % of the travel in sliding
)
_LEAST_BODY, _LEAST_INERTIA = 1e-9, 1e-14  # of J, and at all: MuJoCo wants a moving body to have some inertia
_BODY_SLACK = 1e-12  # of J: what rounding may leave of a body that has all the inertia
_BRISTLE = ("sigma0", "sigma1", "Fc", "Fs", "vs")  # the numbers of `lugre`, in MuJoCo's order
_LIGHT = 0.1  # of J: a body that is lighter loses the frictionloss of a slide
_CREEPS = "is a constraint of MuJoCo's solver, which creeps under a force below break-away."
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
        m = exact(self.trial_inertia)
        actuators = "\n    ".join(self.actuators)
        return f"""<mujoco>
  <option timestep="{exact(step)}" integrator="Euler" gravity="0 0 0"/>
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
    result, drive = parts_of(drive)
    lugre = friction == "lugre"
    values = numbers_of(drive, {"J", "Fc"} | ({"sigma0", "Fs", "vs"} if lugre else set()), "MuJoCo")
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
        "armature": exact(max(J - body_inertia, 0.0)),
        "damping": exact(values["sigma2"]),
    }
    if stiffness:
        attributes["stiffness"] = exact(stiffness)
    if not lugre:
        attributes["frictionloss"] = exact(values["Fc"])
    motor = {"name": f"{name}_motor", "joint": name, "gear": exact(values["motor_constant"])}
    actuators = [element("motor", motor)]
    if lugre:
        bristle = " ".join(exact(values[key]) for key in _BRISTLE)
        dcmotor = {"name": f"{name}_friction", "joint": name, "input": "none", "motorconst": "0"}
        actuators.append(element("dcmotor", dcmotor | {"resistance": "1", "lugre": bristle}))
    lost = () if lugre else (lost_presliding(values, _CREEPS), lost_stribeck(values, "Fc"))
    if not lugre and kind == "slide" and body_inertia < _LIGHT * J:
        lost += (_LIGHT_BODY,)
    return MujocoJoint(
        joint=element("joint", attributes),
        actuators=tuple(actuators),
        lost=(*lost, *lost_effects(drive, (ReturnSpring,))),
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
    return {name: stderr_of_sum(result, dict.fromkeys(labels, 1.0)) for name, labels in sums.items()}


def _fastest(values: dict[str, float]) -> float:
    """The faster time scale of the sticking bristle, s: of its spring or of its damping."""
    J, damping = values["J"], values["sigma1"] + values["sigma2"]
    return min(math.sqrt(J / values["sigma0"]), J / damping if damping else math.inf)
