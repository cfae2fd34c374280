"""The plant: inertia, motor, friction and effects."""

import dataclasses
from collections.abc import Iterator
from typing import Literal, TypeGuard

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core.display import one_line
from frictionjax.core.safe import real, sign
from frictionjax.physics.bristles import Bristles, bristle_count, bristles_of
from frictionjax.physics.effects.base import (
    AbstractCreepEffect,
    AbstractDampingEffect,
    AbstractEffect,
    AbstractForceEffect,
    AbstractInputEffect,
    AbstractLevelEffect,
    AbstractLoadEffect,
    AbstractSensorEffect,
    AbstractSlipEffect,
    AbstractSpringEffect,
    AbstractStateEffect,
    Before,
    LoadSide,
    Now,
)
from frictionjax.physics.lugre import LuGre
from frictionjax.physics.push import Push, mean_of
from frictionjax.physics.velocity_offset import VelocityOffset

_LEAST_LEVEL = 0.01  # over Coulomb friction


class Drive(eqx.Module):
    """A servo drive: J x'' = motor_constant u - F - effects, equation (5).

    **Arguments:**

    - `J`: inertia or mass, force s^2/position.
    - `friction`: the `LuGre` friction.
    - `motor_constant`: force per input unit.
    - `effects`: tuple of effects, each in its own slot.
    - `hold`: what the input does between samples: `"zero"`, it is held; `"linear"`, it runs straight to the next one.
    """

    J: Float[Array, "..."] = eqx.field(converter=real)
    friction: LuGre
    motor_constant: Float[Array, "..."] = eqx.field(converter=real, default=1.0)
    effects: tuple[AbstractEffect, ...] = ()
    hold: Literal["zero", "linear"] = eqx.field(static=True, default="zero")

    def __repr__(self) -> str:
        return one_line(self, *(("hold",) if self.hold == "zero" else ()))

    def with_effects(self, *effects: AbstractEffect) -> "Drive":
        """The same drive with further `effects`."""
        return dataclasses.replace(self, effects=(*self.effects, *effects))

    def _has(self, slot: type[AbstractEffect]) -> bool:
        return any(isinstance(effect, slot) for effect in self.effects)

    @property
    def bristle_count(self) -> int:
        """Number of bristle elements: 1 for LuGre alone."""
        return bristle_count(self.effects)

    def bristles(self) -> Bristles:
        """The bank of bristle elements."""
        return bristles_of(self.effects)

    def applied_force(self, u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"] | Push:
        """Motor force, shape `(n,)`, held over each sample of `dt` s, for the recorded input `u` of shape `(n,)`; a
        `Push` where the input or an effect changes it within a sample. Later effects act on the mean."""
        rises = []
        if self.hold == "linear":
            # After its last sample the input is taken to stay.
            rises.append(jnp.append(u[1:], u[-1:]) - u)
            u = u + 0.5 * rises[0]
        for effect in self.effects:
            if isinstance(effect, AbstractInputEffect):
                applied = effect.apply(u, dt)
                u = mean_of(applied)
                if isinstance(applied, Push):
                    rises.append(applied.rise)
        force = self.motor_constant * u
        return Push(force, self.motor_constant * sum(rises)) if rises else force

    def measured(
        self, x: Float[Array, ""], t: Float[Array, ""], hidden: Float[Array, " m"]
    ) -> Float[Array, ""]:
        """Output of the position sensor at position `x` and `t` s after the first sample, with the states `hidden` of
        effects, shape `(m,)`."""
        for effect, own in self._own_states(hidden):
            if isinstance(effect, AbstractSensorEffect):
                x = effect.measured(x, t, own)
        return x

    @property
    def sensor_integrates(self) -> bool:
        """Whether the measured position is an integrated velocity."""
        return self._has(VelocityOffset)

    @property
    def sensor_has_states(self) -> bool:
        """Whether the sensor's output depends on past motion, through states of its own."""
        return any(_is_sensor_with_states(effect) for effect in self.effects)

    def sensor_states(self, v: Float[Array, ""]) -> Float[Array, " m"]:
        """Steady states of the effects of the sensor at a constant velocity `v`, as `hidden` states of shape `(m,)`;
        zero for all others."""
        hidden = jnp.zeros(self.hidden_count)
        first = 0
        for effect, own in self._with_own_states(self.instant(jnp.zeros_like(v), v, hidden=hidden)):
            count = own.hidden.shape[0]
            if _is_sensor_with_states(effect):
                source, rate = effect.relax(self.friction, own)
                hidden = hidden.at[first : first + count].set(source / rate)
            first += count
        return hidden

    @property
    def state_count(self) -> int:
        """Number of states that effects add, without those of a second inertia."""
        return sum(effect.states for effect in self.effects if isinstance(effect, AbstractStateEffect))

    @property
    def load_side(self) -> LoadSide | None:
        """The second inertia, or None."""
        for effect in self.effects:
            if isinstance(effect, AbstractLoadEffect):
                return effect.load_side()
        return None

    @property
    def hidden_count(self) -> int:
        """Number of states beside position, velocity and bristles: those of effects, then the two of a second inertia
        (its position and velocity against the motor's)."""
        return self.state_count + (2 if self._has(AbstractLoadEffect) else 0)

    def instant(
        self,
        x: Float[Array, ""],
        v: Float[Array, ""],
        push: Float[Array, ""] | float = 0.0,
        spring: Float[Array, ""] | float = 0.0,
        hidden: Float[Array, " m"] | None = None,
    ) -> Now:
        """A `Now` with the states of all effects.

        **Arguments:** `x`, `v`, `push`, `spring` as in `Now`; `hidden`, shape `(m,)` (None: zero).
        """
        states = jnp.zeros(self.hidden_count) if hidden is None else hidden
        return Now(x, v, jnp.asarray(push), jnp.asarray(spring), states)

    def _own_states(
        self, hidden: Float[Array, " m"]
    ) -> Iterator[tuple[AbstractEffect, Float[Array, " own"]]]:
        """Every effect with its own states."""
        first = 0
        for effect in self.effects:
            count = effect.states if isinstance(effect, AbstractStateEffect) else 0
            yield effect, hidden[first : first + count]
            first += count

    def _with_own_states(self, now: Now) -> Iterator[tuple[AbstractEffect, Now]]:
        """Every effect with a `Now` of its own states."""
        for effect, hidden in self._own_states(now.hidden):
            yield effect, Now(now.x, now.v, now.push, now.spring, hidden)

    def level(self, x: Float[Array, ""], v: Float[Array, ""]) -> Float[Array, ""]:
        """Steady-state friction level G without viscous part, force, at position `x` and velocity `v`, for an idle
        motor and states of effects at zero."""
        return self.level_at(self.instant(x, v))

    def level_at(self, now: Now) -> Float[Array, ""]:
        """Steady-state friction level G without viscous part, force, for what is `now`."""
        level = self.friction.level(now.v)
        for effect, own in self._with_own_states(now):
            if isinstance(effect, AbstractLevelEffect):
                # Strengths that are admissible one by one may together make the friction negative.
                level = jnp.maximum(effect.level(level, self.friction, own), _LEAST_LEVEL * self.friction.Fc)
        return level

    def spring_force(self, z: Float[Array, "*d"]) -> Float[Array, "*d"]:
        """Force of LuGre's bristle at deflection `z`, as if it carried all the stiffness: sigma0 z as modified by
        effects."""
        force = self.friction.sigma0 * z
        for effect in self.effects:
            if isinstance(effect, AbstractSpringEffect):
                force = effect.spring(force, self.friction, z)
        return force

    @property
    def has_slip_effects(self) -> bool:
        """Whether an effect changes the slip of LuGre's bristle."""
        return self._has(AbstractSlipEffect)

    @property
    def has_steep_slip(self) -> bool:
        """Whether such an effect may make the slip rise more steeply than LuGre's."""
        return any(isinstance(effect, AbstractSlipEffect) and effect.steep for effect in self.effects)

    def slip(self, bend: Float[Array, "*d"], v: Float[Array, "*d"]) -> Float[Array, "*d"]:
        """Slip velocity of LuGre's bristle over |v|: `bend`, its force over the level, as modified by effects when it
        slips with `v`."""
        for effect in self.effects:
            if isinstance(effect, AbstractSlipEffect):
                bend = effect.slip(bend, sign(v))
        return bend

    def sigma1(self, v: Float[Array, ""]) -> Float[Array, ""]:
        """Damping of the bristles at velocity `v`, force s/position."""
        damping = self.friction.sigma1
        for effect in self.effects:
            if isinstance(effect, AbstractDampingEffect):
                damping = damping * effect.damping(self.friction, v)
        return damping

    def bristle_speed(self, now: Now) -> Float[Array, ""]:
        """Velocity of the bristles, position/s, for what is `now`."""
        speed = now.v
        for effect, own in self._with_own_states(now):
            if isinstance(effect, AbstractCreepEffect):
                speed = speed - effect.bristle_speed(self.friction, own)
        return speed

    def slip_speed(self, now: Now) -> Float[Array, ""]:
        """Velocity at which LuGre's bristle slips, position/s, for what is `now`."""
        speed = now.v
        for effect, own in self._with_own_states(now):
            if isinstance(effect, AbstractCreepEffect):
                speed = speed - effect.slip_speed(self.friction, own)
        return speed

    def relaxation(self, now: Now) -> tuple[Float[Array, " m"], Float[Array, " m"]]:
        """Source and rate (1/s) of the states of effects, h' = source - rate h, shape `(m,)`, for what is `now`."""
        parts = [
            effect.relax(self.friction, own)
            for effect, own in self._with_own_states(now)
            if isinstance(effect, AbstractStateEffect)
        ]
        if not parts:
            return jnp.zeros(0), jnp.zeros(0)
        return jnp.concatenate([part[0] for part in parts]), jnp.concatenate([part[1] for part in parts])

    def initial_states(self, before: Before) -> Float[Array, " m"]:
        """States of effects and of a second inertia at the first sample of a recording, given what was `before`."""
        parts = [
            effect.initial_states(self.friction, before)
            for effect in self.effects
            if isinstance(effect, AbstractStateEffect)
        ]
        return jnp.concatenate([*parts, jnp.zeros(self.hidden_count - self.state_count)])

    @property
    def has_force_effects(self) -> bool:
        """Whether an effect adds a force to the friction."""
        return self._has(AbstractForceEffect)

    def parallel_force(self, now: Now) -> Float[Array, ""]:
        """Opposing force parallel to the bristles for what is `now`: viscous friction and the force effects."""
        force = self.friction.sigma2 * now.v
        for effect, own in self._with_own_states(now):
            if isinstance(effect, AbstractForceEffect):
                force = force + effect.force(self.friction, own)
        return force

    def opposing_force(
        self, bristles: Bristles, now: Now, z: Float[Array, " n"], rate: Float[Array, " n"]
    ) -> Float[Array, ""]:
        """Opposing force (1), with the effects.

        **Arguments:**

        - `bristles`: from `bristles()`, made once per run.
        - `now`: the instant.
        - `z`, `rate`: deflection of each bristle element and its rate, position units and position/s, shape `(n,)`.
        """
        bent = self.friction.sigma0 * jnp.sum(bristles.share[1:] * z[1:])
        bent = bent + bristles.share[0] * self.spring_force(z[0])
        damped = self.sigma1(now.v) * jnp.sum(bristles.share * rate)
        return bent + damped + self.parallel_force(now)

    def friction_force(
        self,
        bristles: Bristles,
        x: Float[Array, ""],
        v: Float[Array, ""],
        z: Float[Array, " n"],
        h: Float[Array, ""],
        hidden: Float[Array, " m"] | None = None,
        push: Float[Array, ""] | float = 0.0,
    ) -> tuple[Float[Array, ""], Float[Array, " n"]]:
        """Opposing force (1), with the effects, and the bristle rates (2), position/s, shape `(n,)`.

        **Arguments:**

        - `bristles`: from `bristles()`, made once per run.
        - `x`, `v`: position and velocity.
        - `z`: deflection of each bristle element, position units, shape `(n,)`.
        - `h`: step, s, over which the rate of an elasto-slip element that yields is the mean.
        - `hidden`: states of the effects that have some, shape `(m,)`; None: zero.
        - `push`: motor force.
        """
        sigma0 = self.friction.sigma0
        level = self.level_at(self.instant(x, v, push, self.spring_force(z[0]), hidden))
        limit = bristles.limit(level, sigma0)
        z = bristles.within(z, limit)
        now = self.instant(x, v, push, self.spring_force(z[0]), hidden)
        w, fast = self.bristle_speed(now), self.slip_speed(now)
        slip = self.slip(now.spring / level, fast)
        rate = bristles.rate(w, fast, slip, jnp.clip(w, (-limit - z) / h, (limit - z) / h))
        return self.opposing_force(bristles, now, z, rate), rate


def _is_sensor_with_states(effect: AbstractEffect) -> TypeGuard[AbstractStateEffect]:
    return isinstance(effect, AbstractSensorEffect) and isinstance(effect, AbstractStateEffect)
