"""Force proportional to position: a return spring, a cable chain, a flexure."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Along, Now
from frictionjax.physics.lugre import LuGre


class ReturnSpring(AbstractForceEffect):
    """J x'' = km u - F - stiffness x.

    **Arguments:**

    - `stiffness`: spring constant, force/position; zero force at the encoder's zero.
    """

    stiffness: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    along: ClassVar[Along] = "position"
    name: ClassVar[str] = "return_spring"
    about: ClassVar[About] = About(
        sentence="a force proportional to position (return spring, cable)",
        equation="J x'' = km u - F - stiffness x",
        shows="a force that grows along the stroke, the same in both directions",
        confused_with=("constant_load", "ripple"),
        split_by="slow moves over the whole stroke in both directions",
        one_law=True,
        of_position=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "stiffness", "{force}/{position}", "spring constant", scale="Fc/stroke", probes=(0.02, 0.2)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.stiffness * now.x
