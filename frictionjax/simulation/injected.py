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
from frictionjax.core.safe import sign
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
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.load_side import contact, relaxed
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
    bristles' velocity is less (position/s), and `slow_slip`, what that is with which LuGre's slips.
    """

    against: Float[Array, "..."]
    lift: Float[Array, "..."]
    bend_force: Float[Array, "..."]
    more_slip: Float[Array, "..."]
    damp: Float[Array, "..."]
    slow: Float[Array, "..."]
    slow_slip: Float[Array, "..."]

    states: ClassVar[int] = 0
    name: ClassVar[str] = "injection"
    about: ClassVar[About] = About("signals of an effect along a known motion", "", "")
    strengths: ClassVar[tuple[Parameter, ...]] = ()
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return jnp.zeros(0), jnp.zeros(0)

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.slow

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.slow_slip

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


class Along(eqx.Module):
    """What a model knows along one recording; arrays of shape `(n,)`, plain numbers whatever effects the model has.

    **Attributes:** `u` (recorded input), `push` (motor force), `x`, `v`, `z` (LuGre's bristle), `spring` (its force),
    `level` (G), `w` (velocity that the bristles see), `fast` (that with which LuGre's slips), `lost` (what it
    slips, of |fast|), `sigma1`, and `a`, the acceleration.
    """

    u: Float[Array, " n"]
    push: Float[Array, " n"]
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    z: Float[Array, " n"]
    spring: Float[Array, " n"]
    level: Float[Array, " n"]
    w: Float[Array, " n"]
    fast: Float[Array, " n"]
    lost: Float[Array, " n"]
    sigma1: Float[Array, " n"]
    a: Float[Array, " n"]


def along(drive: Drive, motion: State, u: Float[Array, " n"], dt: Float[Array, ""]) -> Along:
    """What `drive` knows along the states `motion` (arrays of shape `(n, ...)`) for the input `u`, `dt` s a sample."""
    bristles = drive.bristles()

    def one(state: State, u, push):
        spring = drive.spring_force(state.z[0])
        now = drive.instant(state.x, state.v, push, spring, state.hidden)
        level, w, fast = drive.level_at(now), drive.bristle_speed(now), drive.slip_speed(now)
        opposing = drive.friction_force(bristles, state.x, state.v, state.z, dt, state.hidden, push)[0]
        lost, a = drive.slip(spring / level, fast), (push - opposing) / drive.J
        sigma1 = drive.sigma1(state.v) + 0.0 * state.v
        return Along(u, push, state.x, state.v, state.z[0], spring, level, w, fast, lost, sigma1, a)

    return jax.vmap(one)(motion, u, drive.applied_force(u, dt))


def signals_along(
    friction: LuGre,
    inertia: Float[Array, ""],
    motor_constant: Float[Array, ""],
    effect: AbstractEffect,
    known: Along,
    dt: Float[Array, ""],
    before: Before,
) -> Signals:
    """What `effect`, at any strength, would add to a model's equations along a known motion.

    **Arguments:**

    - `friction`, `inertia`, `motor_constant`: of the model.
    - `effect`: the effect.
    - `known`: from `along`.
    - `dt`: s per sample.
    - `before`: what was before the first sample.
    """
    n = known.u.shape[0]
    other = known.push
    if isinstance(effect, AbstractInputEffect):
        other = other + motor_constant * (effect.apply(known.u, dt) - known.u)
    states = effect.states if isinstance(effect, AbstractStateEffect) else 0
    first = effect.begin(friction, before) if isinstance(effect, AbstractStateEffect) else jnp.zeros(0)

    def sample(carry, here: Along):
        hidden, plays, load = carry
        own = Now(here.x, here.v, here.push, here.spring, hidden)
        against, lift, bend_force, more_slip, damp, slow, slow_slip = 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
        if isinstance(effect, AbstractForceEffect):
            against = effect.force(friction, own)
        if isinstance(effect, AbstractLevelEffect):
            lift = jnp.maximum(effect.level(here.level, friction, own) / here.level, 0.05)
        if isinstance(effect, AbstractSpringEffect):
            bend_force = effect.spring(here.spring, friction, here.z) - here.spring
        if isinstance(effect, AbstractSlipEffect):
            more_slip = effect.slip(here.lost, sign(here.fast)) - here.lost
        if isinstance(effect, AbstractDampingEffect):
            damp = effect.damping(friction, here.v)
        if isinstance(effect, AbstractCreepEffect):
            slow, slow_slip = effect.bristle_speed(friction, own), effect.slip_speed(friction, own)
        if isinstance(effect, AbstractBristleEffect):
            share, slack = effect.share_and_yield()
            limit = here.level * slack / friction.sigma0
            moved = jnp.clip(plays + here.w * dt, -limit, limit)
            rate = here.w - jnp.abs(here.fast) * here.lost
            against = friction.sigma0 * jnp.sum(share * (plays - here.z))
            against = against + here.sigma1 * jnp.sum(share * ((moved - plays) / dt - rate))
            plays = moved
        if isinstance(effect, AbstractLoadEffect):
            side = effect.load_side()
            a2, touches = contact(side, load)
            free, loss = side.drag * (here.v + load[1]), side.damping * touches
            # Damping implicit: the fastest couplings would blow up.
            faster = load[1] + dt * (a2 - free - here.a) / (1.0 + dt * loss)
            against = against + side.ratio * inertia * ((faster - load[1]) / dt + free)
            load = jnp.stack([load[0] + dt * faster, faster])
        if isinstance(effect, AbstractStateEffect):
            hidden = relaxed(hidden, *effect.relax(friction, own), dt)
        parts = (against, lift, bend_force, more_slip, damp, slow, slow_slip)
        injection = Injection(*(part + 0.0 * here.x for part in parts))
        return (hidden, plays, load), (injection, own.hidden)

    count = effect.count if isinstance(effect, AbstractBristleEffect) else 0
    carry = (first, jnp.zeros(count), jnp.zeros(2))
    if states or count or isinstance(effect, AbstractLoadEffect):
        _, (injection, hidden) = jax.lax.scan(sample, carry, known)
    else:
        # Without memory the samples go side by side.
        injection, hidden = jax.vmap(lambda here: sample(carry, here)[1])(known)
    shown = jnp.zeros(n)
    if isinstance(effect, AbstractSensorEffect):
        t = jnp.arange(n, dtype=known.x.dtype) * dt
        shown = jax.vmap(effect.seen)(known.x, t, hidden) - known.x
    return Signals(injection, other, shown)


def injected_innovations(
    drive: Drive,
    signals: Signals,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: Gains,
    start: Start,
    *,
    substeps: int = 1,
) -> Float[Array, " n"]:
    """Innovations of the observer along one recording, shape `(n,)`, with an effect's `signals` in the equations of
    `drive`; the other arguments as in `innovations`."""

    def sample(state, inputs):
        push, measured, t, injection = inputs
        now = drive.with_effects(injection)
        bristles = now.bristles()
        innovation = measured - now.seen(state.x, t, state.hidden)
        state = corrected(now, bristles.slack, state, innovation, gains)
        return advance(now, bristles, state, push, dt, substeps, exact_derivative=False), innovation

    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    inputs = (signals.push, x - signals.shown, t, signals.injection)
    return jax.lax.scan(sample, state_at(drive, start), inputs)[1]
