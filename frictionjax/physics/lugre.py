"""The LuGre friction model: equations (1) and (2) of Hensen, van de Molengraft, Steinbuch (2002)."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.display import one_line
from frictionjax.core.safe import real


class LuGre(eqx.Module):
    """LuGre friction, Canudas de Wit et al. (1995):

        F     = sigma0 z + sigma1 dz/dt + sigma2 v                       (1)
        dz/dt = v - sigma0 |v| z / G(v)                                  (2)
        G(v)  = Fc + (Fs - Fc) exp(-(v/vs)^2)

    with z the mean bristle deflection. Values are not checked here: arrays of any batch shape may be held.

    **Arguments:**

    - `sigma0`: bristle stiffness, force/position.
    - `sigma1`: bristle damping, force s/position.
    - `sigma2`: viscous damping, force s/position.
    - `Fc`: Coulomb friction, force.
    - `Fs`: static friction, force, at least `Fc`.
    - `vs`: Stribeck velocity, position/s.
    """

    sigma0: Float[Array, "..."] = eqx.field(converter=real)
    sigma1: Float[Array, "..."] = eqx.field(converter=real)
    sigma2: Float[Array, "..."] = eqx.field(converter=real)
    Fc: Float[Array, "..."] = eqx.field(converter=real)
    Fs: Float[Array, "..."] = eqx.field(converter=real)
    vs: Float[Array, "..."] = eqx.field(converter=real)

    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sigma0", "{force}/{position}", "bristle stiffness", "log"),
        Parameter("sigma1", "{force}*s/{position}", "bristle damping", "log"),
        Parameter("sigma2", "{force}*s/{position}", "viscous damping", "log"),
        Parameter("Fc", "{force}", "Coulomb friction", "log"),
        Parameter("Fs", "{force}", "static friction", "log"),
        Parameter("vs", "{position}/s", "Stribeck velocity", "log"),
    )

    def level(self, v: Float[Array | np.ndarray, "..."] | float) -> Float[Array, "..."]:
        """Steady-state friction level G(v) without viscous part, force; even in the velocity `v` (position/s)."""
        ratio = v * (1.0 / self.vs)
        return self.Fc + (self.Fs - self.Fc) * jnp.exp(-ratio * ratio)

    def __repr__(self) -> str:
        return one_line(self)
