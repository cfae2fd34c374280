"""What a robot's XML file says of one joint, in its own terms."""

from typing import Literal

import equinox as eqx

from frictionjax.exchange.rigid import JointLoad

INSTALL = 'pip install "frictionjax[mujoco]"'


class JointText(eqx.Module):
    """Numbers of one joint, in SI units.

    **Attributes:**

    - `name`, `kind`: of the joint, `"hinge"` or `"slide"`.
    - `armature`: inertia of the rotor, kg m^2 or kg.
    - `damping`, `frictionloss`: viscous and Coulomb friction.
    - `stiffness`, `rest`: of a spring, and where it is at rest.
    - `load`: the bodies behind the joint; None where that needs MuJoCo.
    - `gear`: force per unit of the input.
    - `bristle`: numbers of LuGre by their names here; empty where there are none.
    - `remarks`: sentences on what was not read, or holds under a condition.
    """

    name: str = eqx.field(static=True)
    kind: Literal["hinge", "slide"] = eqx.field(static=True)
    armature: float = 0.0
    damping: float = 0.0
    frictionloss: float = 0.0
    stiffness: float = 0.0
    rest: float = 0.0
    load: JointLoad | None = None
    gear: float = 1.0
    bristle: dict[str, float] = eqx.field(static=True, default_factory=dict)
    remarks: tuple[str, ...] = eqx.field(static=True, default=())


def held(others: list[str]) -> tuple[str, ...]:
    """The remark on the `others`, joints further out that are taken as locked where the model has them."""
    if not others:
        return ()
    return (f"Inertia and gravity hold with {', '.join(others)} where the model has them at first.",)
