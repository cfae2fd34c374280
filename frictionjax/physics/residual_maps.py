"""Nonparametric models of a missing force: what remains when no effect of the catalogue explains it.

A piecewise linear function of one variable, twelve heights over evenly spaced knots, zero at the base model. The data
select the variable. The maps are effects like any other, but not in the catalogue: they predict the force without
naming its cause.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.arrays import Numbers
from frictionjax.core.safe import real
from frictionjax.physics.effects.base import (
    About,
    AbstractEffect,
    AbstractForceEffect,
    AbstractInputEffect,
    AbstractLevelEffect,
    Now,
)
from frictionjax.physics.lugre import LuGre

KNOTS = 12


def _heights(unit: str, scale: float | str, lower: float = -float("inf")) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f"h{k}", unit, f"height at knot {k + 1} of {KNOTS}", scale=scale, lower=lower, probes=(0.02,)
        )
        for k in range(KNOTS)
    )


def _range(symbol: str, unit: str, center: str, half: str) -> tuple[Parameter, ...]:
    """The range of the knots; `center` and `half` name sizes of the plant."""
    return (
        Parameter("middle", unit, f"middle of the {symbol}", "none", scale=center, grid=(1.0,)),
        Parameter("half", unit, f"half the range of the {symbol}", "none", scale=half, grid=(1.0,)),
    )


class AbstractMap(AbstractEffect):
    """Heights over knots between middle - half and middle + half; constant beyond.

    **Arguments:** `h0` ... `h11`: heights; `middle`, `half`: the range of the variable.
    """

    h0: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h1: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h2: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h3: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h4: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h5: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h6: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h7: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h8: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h9: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h10: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    h11: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    middle: Float[Array, "..."] = eqx.field(converter=real, default=0.0)
    half: Float[Array, "..."] = eqx.field(converter=real, default=1.0)

    def at(self, variable: Float[Numbers, "..."]) -> Float[Array, "..."]:
        """Height at `variable`."""
        place = (variable - self.middle) / self.half
        place = 0.5 * (KNOTS - 1) * (jnp.clip(place, -1.0, 1.0) + 1.0)
        roofs = (getattr(self, f"h{k}") * jnp.maximum(0.0, 1.0 - jnp.abs(place - k)) for k in range(KNOTS))
        return sum(roofs, jnp.zeros_like(place))


def _about(sentence: str, equation: str) -> About:
    return About(sentence=sentence, equation=equation, shows="wherever the catalogue explains nothing")


class PositionForceMap(AbstractMap, AbstractForceEffect):
    """J x'' = km u - F - f(x)."""

    name: ClassVar[str] = "residual_force"
    about: ClassVar[About] = _about("a force that depends on position", "J x'' = km u - F - f(x)")
    strengths: ClassVar[tuple[Parameter, ...]] = _heights("{force}", "Fc")
    nuisances: ClassVar[tuple[Parameter, ...]] = _range("stroke", "{position}", "center", "half_stroke")

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.at(now.x)


class PositionLevelMap(AbstractMap, AbstractLevelEffect):
    """G -> G (1 + f(x))."""

    name: ClassVar[str] = "residual_force"
    about: ClassVar[About] = _about("friction that depends on position", "G -> G (1 + f(x))")
    strengths: ClassVar[tuple[Parameter, ...]] = _heights("1", 1.0, lower=-0.9)
    nuisances: ClassVar[tuple[Parameter, ...]] = _range("stroke", "{position}", "center", "half_stroke")

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * (1.0 + self.at(now.x))


class VelocityForceMap(AbstractMap, AbstractForceEffect):
    """J x'' = km u - F - f(v), knots even in asinh(v/vs)."""

    name: ClassVar[str] = "residual_force"
    about: ClassVar[About] = _about("a force that depends on velocity", "J x'' = km u - F - f(v)")
    strengths: ClassVar[tuple[Parameter, ...]] = _heights("{force}", "Fc")
    nuisances: ClassVar[tuple[Parameter, ...]] = _range("speed, as asinh(v/vs)", "1", "zero", "half_speed")

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.at(jnp.arcsinh(now.v / friction.vs))


class BristleForceMap(AbstractMap, AbstractForceEffect):
    """J x'' = km u - F - f(F_z/Fs), F_z the force of the bristle."""

    name: ClassVar[str] = "residual_force"
    about: ClassVar[About] = _about(
        "a force that depends on the bristles' state", "J x'' = km u - F - f(F_z/Fs)"
    )
    strengths: ClassVar[tuple[Parameter, ...]] = _heights("{force}", "Fc")
    nuisances: ClassVar[tuple[Parameter, ...]] = _range("bend, F_z/Fs", "1", "zero", "one")

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.at(now.spring / friction.Fs)


class InputMap(AbstractMap, AbstractInputEffect):
    """u -> u + f(u)."""

    name: ClassVar[str] = "residual_force"
    about: ClassVar[About] = _about("a force that depends on the input", "u -> u + f(u)")
    strengths: ClassVar[tuple[Parameter, ...]] = _heights("{input}", "u")
    nuisances: ClassVar[tuple[Parameter, ...]] = _range("input", "{input}", "zero", "u")

    def apply(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        return u + self.at(u)


MAPS: dict[str, type[AbstractMap]] = {
    "position": PositionForceMap,
    "position (friction level)": PositionLevelMap,
    "velocity": VelocityForceMap,
    "bristle state": BristleForceMap,
    "input": InputMap,
}
"""Variable of the residual force -> the class."""
