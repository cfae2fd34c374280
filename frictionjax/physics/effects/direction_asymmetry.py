"""Friction that differs with the sign of velocity: in its level, and in its viscous part."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import real, sign
from frictionjax.physics.effects.base import About, AbstractForceEffect, AbstractLevelEffect, Now
from frictionjax.physics.lugre import LuGre

_ABOUT = About(
    sentence="friction that differs with the direction of motion",
    equation="G -> G (1 + coulomb sgn v)  or  sigma2 v -> sigma2 v (1 + viscous sgn v)",
    shows="different friction levels of moves to the left and to the right",
    confused_with=("constant_load",),
    split_by="presliding noise around zero force: a load moves the equilibrium, asymmetric friction does not",
)


class DirectionAsymmetry(AbstractLevelEffect):
    """G(v) -> G(v) (1 + coulomb sgn v). Continuous in motion, because G only divides |v| z.

    **Arguments:**

    - `coulomb`: relative difference of the level: (G+ - G-) / (G+ + G-).
    """

    coulomb: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "direction_asymmetry"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "coulomb", "1", "relative asymmetry of the level", lower=-0.9, upper=0.9, probes=(0.01, 0.1)
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * (1.0 + self.coulomb * sign(now.v))


class ViscousAsymmetry(AbstractForceEffect):
    """sigma2 v -> sigma2 v + viscous sigma2 |v|.

    **Arguments:**

    - `viscous`: relative difference of the viscous damping: (s2+ - s2-) / (s2+ + s2-).
    """

    viscous: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "direction_asymmetry"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            "viscous",
            "1",
            "relative asymmetry of the viscous part",
            lower=-1.0,
            upper=1.0,
            probes=(0.02, 0.2),
        ),
    )
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.viscous * friction.sigma2 * jnp.abs(now.v)


class CoulombAndViscousAsymmetry(AbstractLevelEffect, AbstractForceEffect):
    """Both: G(v) -> G(v) (1 + coulomb sgn v), sigma2 v -> sigma2 v + viscous sigma2 |v|.

    **Arguments:**

    - `coulomb`: relative difference of the level.
    - `viscous`: relative difference of the viscous damping.
    """

    coulomb: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    viscous: Float[Array, "..."] = eqx.field(converter=real, default=0.0)

    name: ClassVar[str] = "direction_asymmetry"
    about: ClassVar[About] = _ABOUT
    strengths: ClassVar[tuple[Parameter, ...]] = DirectionAsymmetry.strengths + ViscousAsymmetry.strengths
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * (1.0 + self.coulomb * sign(now.v))

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.viscous * friction.sigma2 * jnp.abs(now.v)
