"""Presliding displacement that goes on under a constant force."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractStateEffect
from frictionjax.physics.lugre import LuGre


class Creep(AbstractStateEffect):
    """A Kelvin-Voigt element in series with the bristle: d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant.

    The bristle sees v - d x_c/dt.

    **Arguments:**

    - `compliance`: final creep over the elastic deflection.
    - `time_constant`: s.
    """

    compliance: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    time_constant: Float[Array, "..."] = eqx.field(converter=real, default=0.3)

    states: ClassVar[int] = 1
    name: ClassVar[str] = "creep"
    about: ClassVar[About] = About(
        sentence="presliding creep: displacement that goes on under a constant force",
        equation="d x_c/dt = (compliance F_z/sigma0 - x_c)/time_constant, dz/dt = w - |w| F_z/G, w = v - d x_c/dt",
        shows="holds and slow loads below break-away",
        confused_with=("maxwell_slip", "dwell_strengthening"),
        split_by="a force held below break-away for ten seconds, and let go",
        source="Rizos, Fassois 2004",
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "compliance", "1", "creep over elastic deflection", lower=0.0, upper=3.0, probes=(0.02, 0.3)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "time_constant", "s", "time constant", "log", lower=0.005, upper=30.0, grid=(0.02, 0.2, 2.0)
        ),
    )

    def _rate(self, friction: LuGre, hidden, spring):
        return (self.compliance * spring / friction.sigma0 - hidden[0]) / self.time_constant

    def rates(
        self, friction: LuGre, hidden: Float[Array, " states"], v: Float[Array, ""], spring: Float[Array, ""]
    ) -> Float[Array, " states"]:
        return jnp.stack([self._rate(friction, hidden, spring)])

    def bristle_speed(
        self, friction: LuGre, hidden: Float[Array, " states"], v: Float[Array, ""], spring: Float[Array, ""]
    ) -> Float[Array, ""]:
        return v - self._rate(friction, hidden, spring)
