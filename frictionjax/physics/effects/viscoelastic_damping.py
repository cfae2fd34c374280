"""Loss of the bristles that hardly depends on frequency: seals, rubber, structural damping."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractForceEffect, AbstractStateEffect, Along, Now
from frictionjax.physics.lugre import LuGre


class ViscoelasticDamping(AbstractStateEffect, AbstractForceEffect):
    """J x'' = km u - F - stiffness sigma0 sum(z - y_j), dy_j/dt = (z - y_j)/tau_j: parallel Maxwell elements.

    z = F_z/sigma0; the tau_j are `shortest`, ten and a hundred times as long. Between them the loss is nearly constant,
    and the stiffness rises by about `stiffness` sigma0 a decade.

    **Arguments:**

    - `stiffness`: of each element, over `sigma0`.
    - `shortest`: time constant of the fastest element, s.
    """

    stiffness: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    shortest: Float[Array, "..."] = eqx.field(converter=real, default=0.003)

    states: ClassVar[int] = 3
    along: ClassVar[Along] = "since_reversal"
    name: ClassVar[str] = "viscoelastic_damping"
    about: ClassVar[About] = About(
        sentence="viscoelastic loss that hardly depends on frequency (seal, rubber)",
        equation="J x'' = km u - F - stiffness sigma0 sum(z - y_j), dy_j/dt = (z - y_j)/tau_j",
        shows="presliding: stiffness that rises with frequency, and loss at low frequency",
        confused_with=("creep", "return_spring", "sensor_lag"),
        split_by="small presliding noise over three decades of frequency",
        needs=("presliding",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "stiffness", "1", "stiffness of an element, over sigma0", lower=0.0, upper=1.0, probes=(0.01, 0.1)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "shortest", "s", "shortest time constant", "log", lower=1e-4, upper=1.0, grid=(0.001, 0.01)
        ),
    )

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        rate = 1.0 / (self.shortest * 10.0 ** jnp.arange(3.0))
        return now.spring / friction.sigma0 * rate, rate

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.stiffness * (3.0 * now.spring - friction.sigma0 * jnp.sum(now.hidden))
