"""An effect's fingerprint without its structure: what the effect would do along a motion that is known already.

The observer keeps the model's motion at the measured one. What an effect adds to the equations of motion can therefore
be evaluated beforehand, along the observed motion, and injected into the model without it as plain signals. To first
order in the effect that is exact; and one compiled model serves every effect there is, and the next.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.core import Parameter
from frictionjax.core.safe import sign
from frictionjax.physics import Drive, LuGre, Push, mean_of
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
from frictionjax.simulation.lanes import Starts, begin_rows, rows_along, tiled
from frictionjax.simulation.load_side import contact, relaxed
from frictionjax.simulation.observer import Gains, innovation_step
from frictionjax.simulation.ros2 import State


class Injection(
    AbstractCreepEffect,
    AbstractForceEffect,
    AbstractLevelEffect,
    AbstractSpringEffect,
    AbstractSlipEffect,
    AbstractDampingEffect,
):
    """Signals in place of an effect, at one sample.

    **Attributes:** `against`, an opposing force; `lift`, a factor on the level G; `bend_force`, what LuGre's bristle
    carries more (force); `more_slip`, what it slips more (of |v|); `damp`, a factor on sigma1; `slow`, what the
    bristles' velocity is less (position/s), and `slow_slip`, what that is with which LuGre's slips.
    """

    against: Float[Array, ""]
    lift: Float[Array, ""]
    bend_force: Float[Array, ""]
    more_slip: Float[Array, ""]
    damp: Float[Array, ""]
    slow: Float[Array, ""]
    slow_slip: Float[Array, ""]

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


_SILENT = {
    **{field.name: 1.0 if field.name in ("lift", "damp") else 0.0 for field in dataclasses.fields(Injection)},
    "more_push": 0.0,
    "more_rise": 0.0,
    "more_shown": 0.0,
}
"""All that an effect may add to the equations, and its value where there is none: an `Injection`, and what it adds to
the motor force and to the rise of that within a sample (force), and to what the sensor shows (position units)."""
_SLOTS = 2
"""Signals that are stored of each effect, at least: one number for all, so that one compiled model serves them."""


class Signals(eqx.Module):
    """An effect along one recording: the signals that it has, `slots`, of shape `(n,)`; and which of the parts that
    there are each of them is, `places`, shape `(parts, slots)`, of zeros and ones. Most effects have one."""

    slots: tuple[Float[Array, " n"], ...]
    places: Float[Array, "parts slots"]

    def parts(self, here: tuple[Float[Array, ""], ...]) -> dict[str, Float[Array, ""]]:
        """Every part by name, where the slots are `here`."""
        more = [sum(w * value for w, value in zip(row, here, strict=True)) for row in self.places]
        return {
            name: jnp.asarray(silent + added)
            for (name, silent), added in zip(_SILENT.items(), more, strict=True)
        }


def _signals(parts: dict[str, Float[Array, " n"]], n: int) -> Signals:
    """Signals of shape `(n,)` by the name of the part, as what is added to that part."""
    empty = [jnp.zeros(n)] * (_SLOTS - len(parts))
    places = np.zeros((len(_SILENT), max(len(parts), _SLOTS)))
    for slot, name in enumerate(parts):
        places[list(_SILENT).index(name), slot] = 1.0
    return Signals((*(value - _SILENT[name] for name, value in parts.items()), *empty), jnp.asarray(places))


class Along(eqx.Module):
    """What a model knows along one recording; arrays of shape `(n,)`, plain numbers whatever effects the model has.

    **Attributes:** `u` (recorded input), `push` (motor force) and its `rise` within a sample, `x`, `v`, `z`
    (LuGre's bristle), `spring` (its force), `level` (G), `w` (velocity that the bristles see), `fast` (that with which
    LuGre's slips), `lost` (what it slips, of |fast|), `sigma1`, and `a`, the acceleration.
    """

    u: Float[Array, " n"]
    push: Float[Array, " n"]
    rise: Float[Array, " n"]
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

    def one(state: State, u, push, rise):
        spring = drive.spring_force(state.z[0])
        now = drive.instant(state.x, state.v, push, spring, state.hidden)
        level, w, fast = drive.level_at(now), drive.bristle_speed(now), drive.slip_speed(now)
        opposing = drive.friction_force(bristles, state.x, state.v, state.z, dt, state.hidden, push)[0]
        lost, a = drive.slip(spring / level, fast), (push - opposing) / drive.J
        sigma1 = drive.sigma1(state.v) + 0.0 * state.v
        return Along(u, push, rise, state.x, state.v, state.z[0], spring, level, w, fast, lost, sigma1, a)

    applied = drive.applied_force(u, dt)
    rise = applied.rise if isinstance(applied, Push) else jnp.zeros_like(u)
    return jax.vmap(one)(motion, u, mean_of(applied), rise)


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
    n, found = known.u.shape[0], {}
    if isinstance(effect, AbstractInputEffect):
        applied = effect.apply(known.u, dt)
        found["more_push"] = motor_constant * (mean_of(applied) - known.u)
        if isinstance(applied, Push):
            found["more_rise"] = motor_constant * applied.rise
    states = effect.states if isinstance(effect, AbstractStateEffect) else 0
    first = effect.begin(friction, before) if isinstance(effect, AbstractStateEffect) else jnp.zeros(0)

    def sample(carry, inputs: tuple[Along, Along]):
        (hidden, plays, load), (here, there) = carry, inputs
        own, parts = Now(here.x, here.v, here.push, here.spring, hidden), {}
        if isinstance(effect, AbstractForceEffect):
            parts["against"] = effect.force(friction, own)
        if isinstance(effect, AbstractLevelEffect):
            parts["lift"] = jnp.maximum(effect.level(here.level, friction, own) / here.level, 0.05)
        if isinstance(effect, AbstractSpringEffect):
            parts["bend_force"] = effect.spring(here.spring, friction, here.z) - here.spring
        if isinstance(effect, AbstractSlipEffect):
            parts["more_slip"] = effect.slip(here.lost, sign(here.fast)) - here.lost
        if isinstance(effect, AbstractDampingEffect):
            parts["damp"] = effect.damping(friction, here.v)
        if isinstance(effect, AbstractCreepEffect):
            parts["slow"] = effect.bristle_speed(friction, own)
            parts["slow_slip"] = effect.slip_speed(friction, own)
        if isinstance(effect, AbstractBristleEffect):
            share, slack = effect.share_and_yield()
            limit = here.level * slack / friction.sigma0
            moved = jnp.clip(plays + here.w * dt, -limit, limit)
            rate = here.w - jnp.abs(here.fast) * here.lost
            against = friction.sigma0 * jnp.sum(share * (plays - here.z))
            against = against + here.sigma1 * jnp.sum(share * ((moved - plays) / dt - rate))
            parts["against"] = parts.get("against", 0.0) + against
            plays = moved
        if isinstance(effect, AbstractLoadEffect):
            side = effect.load_side()
            a2, touches = contact(side, load)
            free, loss = side.drag * (here.v + load[1]), side.damping * touches
            # Damping implicit: the fastest couplings would blow up.
            faster = load[1] + dt * (a2 - free - here.a) / (1.0 + dt * loss)
            against = side.ratio * inertia * ((faster - load[1]) / dt + free)
            parts["against"] = parts.get("against", 0.0) + against
            load = jnp.stack([load[0] + dt * faster, faster])
        if isinstance(effect, AbstractStateEffect):
            # Source and rate as they are in the mean over the sample, as in the model itself.
            source, rate = effect.relax(friction, own)
            ahead = Now(there.x, there.v, here.push, there.spring, relaxed(hidden, source, rate, dt))
            source_1, rate_1 = effect.relax(friction, ahead)
            hidden = relaxed(hidden, 0.5 * (source + source_1), 0.5 * (rate + rate_1), dt)
        # Also what does not depend on the sample is a signal.
        parts = {name: part + 0.0 * here.x for name, part in parts.items()}
        return (hidden, plays, load), (parts, own.hidden)

    count = effect.count if isinstance(effect, AbstractBristleEffect) else 0
    carry = (first, jnp.zeros(count), jnp.zeros(2))
    if states or count or isinstance(effect, AbstractLoadEffect):
        after = jax.tree.map(lambda signal: jnp.append(signal[1:], signal[-1]), known)
        _, (parts, hidden) = jax.lax.scan(sample, carry, (known, after))
    else:
        # Without memory the samples go side by side.
        parts, hidden = jax.vmap(lambda here: sample(carry, (here, here))[1])(known)
    if isinstance(effect, AbstractSensorEffect):
        t = jnp.arange(n, dtype=known.x.dtype) * dt
        found["more_shown"] = jax.vmap(effect.seen)(known.x, t, hidden) - known.x
    return _signals(found | parts, n)


def injected_innovations(
    drives: Drive,
    signals: Signals,
    force: Float[Array, "r n"] | Push,
    x: Float[Array, "r n"],
    dt: Float[Array, " r"],
    gains: Gains,
    start: Starts,
    *,
    substeps: int = 1,
) -> Float[Array, "k r n"]:
    """Innovations of the observer with effects' `signals` in the equations of `k` drives, in each of `r` recordings.

    **Arguments:** leaves of `drives` have the shape `(k, ...)`, those of `signals` `(k, r, ...)`; `force` is that of
    the drives without the effects, the same for all; the others as in `innovations_side_by_side`.
    """
    count, recordings = start[2].shape
    rows, begin = begin_rows(drives, start[2], start)
    slots, places = jax.tree.map(
        lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), (signals.slots, signals.places)
    )

    def step(fixed, state, shared, slots):
        (drive, places, dt, gains), (push, measured, t) = fixed, shared
        parts = Signals(slots, places).parts(slots)
        rise = parts.pop("more_rise") + (push.rise if isinstance(push, Push) else 0.0)
        push = Push(mean_of(push) + parts.pop("more_push"), rise)
        measured = measured - parts.pop("more_shown")
        now = drive.with_effects(Injection(**parts))
        return innovation_step(now, dt, gains, substeps)(state, (push, measured, t))

    t = jnp.arange(x.shape[1], dtype=x.dtype)[None] * dt[:, None]
    times, every = tiled((dt, gains), count)
    found = rows_along(step, count, (rows, places, times, every), begin, (force, x, t), slots)
    return found.reshape(count, recordings, -1)
