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
    AbstractSpringEffect,
    AbstractStateEffect,
)
from frictionjax.physics.lugre import LuGre

_LEAST_LEVEL = 0.01  # over Coulomb friction


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
                # Strengths that are admissible one by one may together ask for friction that pushes.
                level = jnp.maximum(effect.level(level, self.friction, x, v), _LEAST_LEVEL * self.friction.Fc)
        return level

    @property
    def hidden_count(self) -> int:
        """Number of states that effects add to position, velocity and bristles."""
        return sum(effect.states for effect in self.effects if isinstance(effect, AbstractStateEffect))

    def spring_force(self, z: Float[Array, ""]) -> Float[Array, ""]:
        """Force of LuGre's bristle, as if it carried all the stiffness, at deflection `z`: sigma0 z and what effects
        make of it."""
        force = self.friction.sigma0 * z
        for effect in self.effects:
            if isinstance(effect, AbstractSpringEffect):
                force = effect.spring(force, self.friction, z)
        return force

    def hidden_rates(
        self, hidden: Float[Array, " m"], v: Float[Array, ""], spring: Float[Array, ""]
    ) -> tuple[Float[Array, " m"], Float[Array, ""]]:
        """Time derivatives of the `hidden` states, shape `(m,)`, and the velocity that the bristles see, at velocity
        `v` and bristle force `spring`."""
        rates, first, speed = [], 0, v
        for effect in self.effects:
            if isinstance(effect, AbstractStateEffect):
                own = hidden[first : first + effect.states]
                rates.append(effect.rates(self.friction, own, v, spring))
                speed = effect.bristle_speed(self.friction, own, speed, spring)
                first += effect.states
        return (jnp.concatenate(rates) if rates else jnp.zeros(0)), speed

    @property
    def has_force_effects(self) -> bool:
        """Whether a force stands beside the friction."""
        return any(isinstance(effect, AbstractForceEffect) for effect in self.effects)

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
        bent = self.friction.sigma0 * jnp.sum(bristles.share[1:] * z[1:])
        bent = bent + bristles.share[0] * self.spring_force(z[0])
        damped = self.friction.sigma1 * jnp.sum(bristles.share * rate)
        return bent + damped + self.parallel_force(x, v)

    def friction_force(
        self,
        bristles: Bristles,
        x: Float[Array, ""],
        v: Float[Array, ""],
        z: Float[Array, " n"],
        h: Float[Array, ""],
        hidden: Float[Array, " m"] | None = None,
    ) -> tuple[Float[Array, ""], Float[Array, " n"]]:
        """Opposing force (1), with the effects, and the bristle rates (2), position/s, shape `(n,)`.

        **Arguments:**

        - `bristles`: from `bristles()`, made once per run.
        - `x`, `v`: position and velocity.
        - `z`: deflection of each bristle element, position units, shape `(n,)`.
        - `h`: step, s, over which the rate of an elasto-slip element that yields is the mean.
        - `hidden`: states of the effects that have some, shape `(m,)`; None: zero.
        """
        level, sigma0 = self.level(x, v), self.friction.sigma0
        limit = bristles.limit(level, sigma0)
        z = bristles.within(z, limit)
        spring = self.spring_force(z[0])
        _, w = self.hidden_rates(jnp.zeros(self.hidden_count) if hidden is None else hidden, v, spring)
        rate = bristles.rate(w, spring / level, jnp.clip(w, (-limit - z) / h, (limit - z) / h))
        return self.opposing_force(bristles, x, v, z, rate), rate
