"""Friction level that follows velocity with a delay, as the lubricant film builds up."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractLevelEffect, AbstractStateEffect, Now
from frictionjax.physics.lugre import LuGre

_SHORTEST = 1e-9  # s
_USUAL = 5e-3  # s; 1 to 50 ms were measured: a time of the lubricant film, whatever the recorder


class FrictionLag(AbstractStateEffect, AbstractLevelEffect):
    """G(v) -> G(w) with lag dw/dt = v - w.

    At `lag` 0 the derivative is zero by construction: the effect of a lag shows at a finite step.

    **Arguments:**

    - `lag`: s, not negative.
    """

    lag: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    states: ClassVar[int] = 1
    name: ClassVar[str] = "friction_lag"
    about: ClassVar[About] = About(
        sentence="friction that follows velocity with a delay in sliding",
        equation="G(v) -> G(w), lag dw/dt = v - w",
        shows="fast changes of a slow velocity: a loop of friction over velocity that widens with frequency",
        confused_with=("creep", "stribeck_shape"),
        split_by="a velocity around vs that never turns, varied slowly and then fast",
        source="Hess, Soom 1990; Armstrong-Helouvry, Dupont, Canudas de Wit 1994",
        needs=("sliding",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter("lag", "s", "lag behind velocity", scale=_USUAL, lower=0.0, probes=(0.2, 1.0, 5.0)),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        rate = 1.0 / jnp.maximum(self.lag, _SHORTEST)
        return (rate * now.v)[None], rate[None]

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        late = level + (friction.level(now.hidden[0]) - friction.level(now.v))
        return jnp.where(self.lag > _SHORTEST, late, level)
