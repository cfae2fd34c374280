"""The plant: inertia, motor, friction and whatever effects are added to them."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core.safe import real
from frictionjax.physics.bristles import Bristles, bristle_count, bristles_of
from frictionjax.physics.effects.base import (
    AbstractEffect,
    AbstractForceEffect,
    AbstractInputEffect,
    AbstractLevelEffect,
)
from frictionjax.physics.lugre import LuGre


class Drive(eqx.Module):
    """A machine that moves: J x'' = motor_constant u - F - effects, equation (5).

    **Arguments:**

    - `J`: inertia or mass, force s^2/position.
    - `friction`: the `LuGre` friction.
    - `motor_constant`: force per input unit.
    - `effects`: tuple of effects, each in its own slot.
    """

    J: Float[Array, "..."] = eqx.field(converter=real)
    friction: LuGre
    motor_constant: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    effects: tuple[AbstractEffect, ...] = ()

    def with_effects(self, *effects: AbstractEffect) -> "Drive":
        """The same machine with `effects` added to those it has."""
        return Drive(self.J, self.friction, self.motor_constant, (*self.effects, *effects))

    @property
    def bristle_count(self) -> int:
        """Number of bristle elements: 1 for LuGre alone."""
        return bristle_count(self.effects)

    def bristles(self) -> Bristles:
        """The bank of bristle elements."""
        return bristles_of(self.effects)

    def applied_force(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
        """Motor force, shape `(n,)`, held over each sample of `dt` s, for the recorded input `u` of shape `(n,)`."""
        for effect in self.effects:
            if isinstance(effect, AbstractInputEffect):
                u = effect.apply(u, dt)
        return self.motor_constant * u

    def level(self, x: Float[Array, ""], v: Float[Array, ""]) -> Float[Array, ""]:
        """Steady-state friction level G without viscous part, force, at position `x` and velocity `v`."""
        level = self.friction.level(v)
        for effect in self.effects:
            if isinstance(effect, AbstractLevelEffect):
                level = effect.level(level, self.friction, x, v)
        return level

    def parallel_force(self, x: Float[Array, ""], v: Float[Array, ""]) -> Float[Array, ""]:
        """Opposing force without memory at position `x` and velocity `v`: viscous friction and the force effects."""
        force = self.friction.sigma2 * v
        for effect in self.effects:
            if isinstance(effect, AbstractForceEffect):
                force = force + effect.force(self.friction, x, v)
        return force

    def opposing_force(
        self,
        bristles: Bristles,
        x: Float[Array, ""],
        v: Float[Array, ""],
        z: Float[Array, " n"],
        rate: Float[Array, " n"],
    ) -> Float[Array, ""]:
        """Opposing force (1), with the effects.

        **Arguments:**

        - `bristles`: from `bristles()`, made once per run.
        - `x`, `v`: position and velocity.
        - `z`, `rate`: deflection of each bristle element and its rate, position units and position/s, shape `(n,)`.
        """
        bent = self.friction.sigma0 * jnp.sum(bristles.share * z)
        damped = self.friction.sigma1 * jnp.sum(bristles.share * rate)
        return bent + damped + self.parallel_force(x, v)

    def friction_force(
        self,
        bristles: Bristles,
        x: Float[Array, ""],
        v: Float[Array, ""],
        z: Float[Array, " n"],
        h: Float[Array, ""],
    ) -> tuple[Float[Array, ""], Float[Array, " n"]]:
        """Opposing force (1), with the effects, and the bristle rates (2), position/s, shape `(n,)`.

        **Arguments:**

        - `bristles`: from `bristles()`, made once per run.
        - `x`, `v`: position and velocity.
        - `z`: deflection of each bristle element, position units, shape `(n,)`.
        - `h`: step, s, over which the rate of an elasto-slip element that yields is the mean.
        """
        level, sigma0 = self.level(x, v), self.friction.sigma0
        limit = bristles.limit(level, sigma0)
        z = bristles.within(z, limit)
        rate = bristles.rate(v, z, level, sigma0, jnp.clip(v, (-limit - z) / h, (limit - z) / h))
        return self.opposing_force(bristles, x, v, z, rate), rate
