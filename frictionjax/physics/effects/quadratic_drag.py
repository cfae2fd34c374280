"""Drag that grows faster than velocity: windage, churning."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, Now
from frictionjax.physics.lugre import LuGre

_SPLIT = "constant-velocity moves up to the highest speed"


class QuadraticDrag(AbstractForceEffect):
    """J x'' = km u - F - drag v |v|.

    **Arguments:**

    - `drag`: force (s/position)^2.
    """

    drag: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "quadratic_drag"
    about: ClassVar[About] = About(
        sentence="drag proportional to the square of velocity",
        equation="J x'' = km u - F - drag v |v|",
        shows="the fastest moves, alike in both directions",
        confused_with=("stribeck_shape",),
        split_by=_SPLIT,
        needs=("sliding",),
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "drag",
            "{force}*s^2/{position}^2",
            "quadratic drag",
            scale="Fc/speed^2",
            lower=0.0,
            probes=(0.02, 0.3),
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.drag * now.v * jnp.abs(now.v)


class CubicDrag(AbstractForceEffect):
    """J x'' = km u - F - drag v^3.

    **Arguments:**

    - `drag`: force (s/position)^3.
    """

    drag: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "quadratic_drag"
    about: ClassVar[About] = About(
        sentence="drag that grows with the cube of velocity",
        equation="J x'' = km u - F - drag v^3",
        shows="the fastest moves, alike in both directions",
        confused_with=("stribeck_shape",),
        split_by=_SPLIT,
        needs=("sliding",),
        one_law=True,
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "drag",
            "{force}*s^3/{position}^3",
            "cubic drag",
            scale="Fc/speed^3",
            lower=0.0,
            probes=(0.02, 0.3),
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.drag * now.v * now.v * now.v
