"""Presliding that is elastic up to a break-away deflection: no bristle slips below it."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import About, AbstractSlipEffect


class ElastoPlastic(AbstractSlipEffect):
    """dz/dt = v - |v| b (1 - plasticity + plasticity alpha(b, v)) with b = F_z/G; `plasticity` 1 is Dupont's model.

    alpha is 0 for |b| below `core` and where z and v have opposite signs, rises with w = (|b| - core)/(1 - core) as
    1/2 - ((1 - overtone) cos(pi w) + overtone cos(3 pi w))/2, and is 1 from |b| = 1 on. Dupont's half cosine has no
    overtone. The true rise is unknown, and a wrong one biases the break-away deflection by far more than its standard
    error.

    **Arguments:**

    - `plasticity`: from LuGre (0) to the elasto-plastic model (1).
    - `core`: break-away deflection over that of steady sliding.
    - `overtone`: shape of the rise; from -1/8 to 1/4 it never falls.
    """

    plasticity: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    core: Float[Array, "..."] = eqx.field(converter=real, default=0.5)
    overtone: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "elasto_plastic"
    about: ClassVar[About] = About(
        sentence="no bristle slip below a break-away deflection (elasto-plastic presliding)",
        equation="dz/dt = v - alpha(z, v) |v| F_z/G(v); alpha = 0 below the break-away deflection, 1 in sliding",
        shows="presliding: an elastic core; no drift under vibration below break-away",
        confused_with=("maxwell_slip", "nonlinear_bristle", "load_dependence"),
        split_by="half of break-away with a small 20 Hz dither for 30 s: LuGre creeps on, an elastic core does not",
        source="Dupont, Hayward, Armstrong, Altpeter 2002",
        needs=("presliding",),
    )
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "plasticity",
            "1",
            "from LuGre to elasto-plastic",
            lower=0.0,
            upper=1.0,
            probes=(0.05, 0.5),
            # No machine is half plastic, and between the two models the misfit has local maxima.
            other_start=0.95,
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "core", "1", "break-away over sliding deflection", lower=0.0, upper=0.97, grid=(0.2, 0.5, 0.8)
        ),
        Parameter(
            "overtone",
            "1",
            "shape of the rise from break-away to sliding",
            lower=-0.12,
            upper=0.24,
            grid=(0.0,),
        ),
    )

    def slip(self, bend: Float[Array, "*d"], direction: Float[Array, "*d"]) -> Float[Array, "*d"]:
        way = (jnp.abs(bend) - self.core) / (1.0 - self.core)
        angle = jnp.pi * jnp.where((way > 0.0) & (way < 1.0), way, 0.0)
        rising = 0.5 - 0.5 * ((1.0 - self.overtone) * jnp.cos(angle) + self.overtone * jnp.cos(3.0 * angle))
        alpha = jnp.where(bend * direction > 0.0, jnp.where(way < 1.0, rising, 1.0), 0.0)
        return bend + self.plasticity * (alpha - 1.0) * bend
