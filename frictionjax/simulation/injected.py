"""An effect's fingerprint without its structure: what the effect would do along a motion that is known already.

The observer keeps the model's motion at the measured one. What an effect adds to the equations of motion can therefore
be evaluated beforehand, along the observed motion, and injected into the model without it as plain signals. To first
order in the effect that is exact; and one compiled model serves every effect there is, and the next.
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects import (
    About,
    AbstractBristleEffect,
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
    Now,
)
from frictionjax.simulation.fixed import Start, initial_state
from frictionjax.simulation.load_side import relaxed
from frictionjax.simulation.observer import Gains, corrected
from frictionjax.simulation.ros2 import State, advance


class Injection(
    AbstractCreepEffect,
    AbstractForceEffect,
    AbstractLevelEffect,
    AbstractSpringEffect,
    AbstractSlipEffect,
    AbstractDampingEffect,
):
    """Signals in place of an effect. Scalars for one sample, shape `(n,)` for a recording.

    **Attributes:** `against`, an opposing force; `lift`, a factor on the level G; `bend_force`, what LuGre's bristle
    carries more (force); `more_slip`, what it slips more (of |v|); `damp`, a factor on sigma1; `slow`, what the
    bristles' velocity is less (position/s).
    """

    against: Float[Array, "..."]
    lift: Float[Array, "..."]
    bend_force: Float[Array, "..."]
    more_slip: Float[Array, "..."]
    damp: Float[Array, "..."]
    slow: Float[Array, "..."]

    states: ClassVar[int] = 0
    name: ClassVar[str] = "injection"
    about: ClassVar[About] = About("signals of an effect along a known motion", "", "")
    strengths: ClassVar[tuple[Parameter, ...]] = ()
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return jnp.zeros(0), jnp.zeros(0)

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.slow

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.against

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * self.lift

    def spring(self, force: Float[Array, ""], friction: LuGre, z: Float[Array, ""]) -> Float[Array, ""]:
        return force + self.bend_force

    def slip(self, bend: Float[Array, ""], direction: Float[Array, ""]) -> Float[Array, ""]:
        return bend + self.more_slip

    def damping(self, friction: LuGre, v: Float[Array, ""]) -> Float[Array, ""]:
        return self.damp


class Signals(eqx.Module):
    """An effect along one recording: the `injection` and the motor force as the effect makes it, `push` (force), and
    what the sensor shows more, `shown` (position units); all of shape `(n,)`."""

    injection: Injection
    push: Float[Array, " n"]
    shown: Float[Array, " n"]


def signals_along(
    drive: Drive,
    effect: AbstractEffect,
    motion: State,
    u: Float[Array, " n"],
    dt: Float[Array, ""],
    before: Before,
) -> Signals:
    """What `effect` would add to the equations of `drive` along a known motion.

    **Arguments:**

    - `drive`: the model without the effect.
    - `effect`: the effect, at any strength.
    - `motion`: states of `drive` at the samples, arrays of shape `(n, ...)`.
    - `u`: recorded input, shape `(n,)`.
    - `dt`: s per sample.
    - `before`: what was before the first sample.
    """
    friction, bristles, n = drive.friction, drive.bristles(), u.shape[0]
    push = drive.applied_force(u, dt)
    other = (
        drive.with_effects(effect).applied_force(u, dt) if isinstance(effect, AbstractInputEffect) else push
    )
    states = effect.states if isinstance(effect, AbstractStateEffect) else 0
    first = effect.begin(friction, before) if isinstance(effect, AbstractStateEffect) else jnp.zeros(0)
    t = jnp.arange(n, dtype=u.dtype) * dt

    def acceleration(state: State, push):
        opposing = drive.friction_force(bristles, state.x, state.v, state.z, dt, state.hidden, push)[0]
        return (push - opposing) / drive.J

    def whole(state: State, push):
        spring = drive.spring_force(state.z[0])
        return drive.instant(state.x, state.v, push, spring, state.hidden)

    def sample(carry, inputs):
        hidden, plays, load = carry
        state, push = inputs
        now = whole(state, push)
        own = Now(now.x, now.v, now.push, now.spring, hidden)
        level, w = drive.level_at(now), drive.bristle_speed(now)
        bend = now.spring / level
        against, lift, bend_force, more_slip, damp, slow = 0.0, 1.0, 0.0, 0.0, 1.0, 0.0
        if isinstance(effect, AbstractForceEffect):
            against = effect.force(friction, own)
        if isinstance(effect, AbstractLevelEffect):
            lift = jnp.maximum(effect.level(level, friction, own) / level, 0.05)
        if isinstance(effect, AbstractSpringEffect):
            bend_force = effect.spring(now.spring, friction, state.z[0]) - now.spring
        if isinstance(effect, AbstractSlipEffect):
            direction = jnp.where(w < 0.0, -1.0, 1.0)
            lost = drive.slip(bend, w)
            more_slip = effect.slip(lost, direction) - lost
        if isinstance(effect, AbstractDampingEffect):
            damp = effect.damping(friction, state.v)
        if isinstance(effect, AbstractCreepEffect):
            slow = effect.bristle_speed(friction, own)
        if isinstance(effect, AbstractBristleEffect):
            share, slack = effect.share_and_yield()
            limit = level * slack / friction.sigma0
            moved = bristles.cut(plays + w * dt, limit)
            rate = w - jnp.abs(w) * bend
            against = friction.sigma0 * jnp.sum(share * (plays - state.z[0]))
            against = against + drive.sigma1(state.v) * jnp.sum(share * ((moved - plays) / dt - rate))
            plays = moved
        if isinstance(effect, AbstractLoadEffect):
            side = effect.load_side()
            beyond = load[0] - jnp.clip(load[0], -side.half_gap, side.half_gap)
            touches = jnp.where(jnp.abs(load[0]) >= side.half_gap, 1.0, 0.0)
            a1 = acceleration(state, push)
            # Damping implicit: the fastest couplings would blow up.
            pull = -side.stiffness * beyond - a1
            faster = (load[1] + dt * pull) / (1.0 + dt * side.damping * touches)
            against = against + side.ratio * drive.J * (faster - load[1]) / dt
            load = jnp.stack([load[0] + dt * faster, faster])
        if states:
            hidden = relaxed(hidden, *effect.relax(friction, own), dt)  # type: ignore[attr-defined]
        parts = (against, lift, bend_force, more_slip, damp, slow)
        return (hidden, plays, load), Injection(*(part + 0.0 * state.x for part in parts))

    count = effect.count if isinstance(effect, AbstractBristleEffect) else 0
    carry = (first, jnp.zeros(count), jnp.zeros(2))
    if states or count or isinstance(effect, AbstractLoadEffect):
        _, injection = jax.lax.scan(sample, carry, (motion, push))
    else:
        # Without memory the samples go side by side.
        injection = jax.vmap(lambda *inputs: sample(carry, inputs)[1])(motion, push)
    shown = jnp.zeros(n)
    if isinstance(effect, AbstractSensorEffect):
        shown = jax.vmap(effect.seen)(motion.x, motion.v, t) - motion.x
    return Signals(injection, other, shown)


def injected_innovations(
    drive: Drive,
    signals: Signals,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: Gains,
    start: Start,
) -> Float[Array, " n"]:
    """Innovations of the observer along one recording, shape `(n,)`, with an effect's `signals` in the equations of
    `drive`; the other arguments as in `innovations`."""

    def sample(state, inputs):
        push, measured, t, injection = inputs
        now = drive.with_effects(injection)
        bristles = now.bristles()
        innovation = measured - now.seen(state.x, state.v, t)
        state = corrected(now, bristles.slack, state, innovation, gains)
        return advance(now, bristles, state, push, dt, 1, exact_derivative=False), innovation

    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    inputs = (signals.push, x - signals.shown, t, signals.injection)
    return jax.lax.scan(sample, initial_state(drive, *start), inputs)[1]
