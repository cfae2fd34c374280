"""Constant force: gravity on a slide, bias of the amplifier, preload."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre


class ConstantLoad(AbstractForceEffect):
    """J x'' = km u - F - load.

    **Arguments:**

    - `load`: the constant force, positive when it pushes towards negative x, force units.
    """

    load: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "constant_load"
    about: ClassVar[About] = About(
        sentence="a constant force (gravity, bias, preload)",
        equation="J x'' = km u - F - load",
        shows="the same force in both directions, and in the equilibrium of presliding",
        confused_with=("direction_asymmetry", "return_spring"),
        split_by="presliding noise around zero force: a load moves the equilibrium, asymmetric friction does not",
        one_law=True,
        of_position=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("load", "{force}", "constant force", scale="Fc", probes=(0.01, 0.1)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.load + 0.0 * now.x
