"""Effects as signals: the terms that an effect would add to the equations along a known motion.

The observer keeps the model's motion close to the measured one. The terms that an effect adds to the equations of
motion can therefore be evaluated in advance, along the observed motion, and injected as signals into the model without
the effect. That is exact to first order in the effect, and one compiled model serves every effect.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.core import Parameter
from frictionjax.core.arrays import Numbers
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
from frictionjax.simulation.lanes import Starts, rows_along, start_rows, tiled
from frictionjax.simulation.load_side import contact, relaxed
from frictionjax.simulation.observer import ObserverGains, innovation_step
from frictionjax.simulation.ros2 import DriveState, Substeps
from frictionjax.simulation.samples import scan_samples


class Injection(
    AbstractCreepEffect,
    AbstractForceEffect,
    AbstractLevelEffect,
    AbstractSpringEffect,
    AbstractSlipEffect,
    AbstractDampingEffect,
):
    """Signals in place of an effect, at one sample.

    **Attributes:** `opposing`, an opposing force; `level_factor`, on the level G; `bristle_force`, added to the force
    of LuGre's bristle; `slip_change`, added to its slip (of |v|); `damping_factor`, on sigma1; `bristle_creep`,
    subtracted from the bristles' velocity (position/s), and `slip_creep`, from that at which LuGre's slips.
    """

    opposing: Float[Array, ""]
    level_factor: Float[Array, ""]
    bristle_force: Float[Array, ""]
    slip_change: Float[Array, ""]
    damping_factor: Float[Array, ""]
    bristle_creep: Float[Array, ""]
    slip_creep: Float[Array, ""]

    states: ClassVar[int] = 0
    steep: ClassVar[bool] = False
    name: ClassVar[str] = "injection"
    about: ClassVar[About] = About("signals of an effect along a known motion", "", "")
    strengths: ClassVar[tuple[Parameter, ...]] = ()
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def relax(self, friction: LuGre, now: Now) -> tuple[Float[Array, " states"], Float[Array, " states"]]:
        return jnp.zeros(0), jnp.zeros(0)

    def bristle_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.bristle_creep

    def slip_speed(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.slip_creep

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        return self.opposing

    def level(self, level: Float[Array, ""], friction: LuGre, now: Now) -> Float[Array, ""]:
        return level * self.level_factor

    def spring(self, force: Float[Array, "*d"], friction: LuGre, z: Float[Array, "*d"]) -> Float[Array, "*d"]:
        return force + self.bristle_force

    def slip(self, bend: Float[Array, "*d"], direction: Float[Array, "*d"]) -> Float[Array, "*d"]:
        return bend + self.slip_change

    def damping(self, friction: LuGre, v: Float[Array, ""]) -> Float[Array, ""]:
        return self.damping_factor


_NEUTRAL = {
    **{
        field.name: 1.0 if field.name in ("level_factor", "damping_factor") else 0.0
        for field in dataclasses.fields(Injection)
    },
    "motor_force": 0.0,
    "motor_rise": 0.0,
    "sensor_error": 0.0,
}
"""All terms that an effect may add to the equations, with their neutral values: the fields of `Injection`, and
additions to the motor force, to its rise within a sample (force), and to the sensor's output (position units)."""
_SLOTS = 2
"""Least number of signals that are stored of an effect: equal for most, so that one compiled model serves them."""


class Signals(eqx.Module):
    """An effect along one recording: its signals, `slots`, of shape `(n,)`; and to which of the terms each of them
    belongs, `places`, shape `(parts, slots)`, of zeros and ones. Most effects have one."""

    slots: tuple[Float[Numbers, "*n"], ...]
    places: Float[Numbers, "*k parts slots"]

    def parts(self, here: tuple[Float[Array, ""], ...]) -> dict[str, Float[Array, ""]]:
        """Every term by name, for the values `here` of the slots."""
        more = [sum(w * value for w, value in zip(row, here, strict=True)) for row in self.places]
        return {
            name: jnp.asarray(neutral + added)
            for (name, neutral), added in zip(_NEUTRAL.items(), more, strict=True)
        }


def _signals(parts: dict[str, Float[Array, " n"]], n: int) -> Signals:
    """Signals of shape `(n,)` by the name of their term, less the neutral value of that term."""
    empty = [jnp.zeros(n)] * (_SLOTS - len(parts))
    places = np.zeros((len(_NEUTRAL), max(len(parts), _SLOTS)))
    for slot, name in enumerate(parts):
        places[list(_NEUTRAL).index(name), slot] = 1.0
    return Signals((*(value - _NEUTRAL[name] for name, value in parts.items()), *empty), jnp.asarray(places))


def force_signals(force: Float[np.ndarray, "k w n"]) -> Signals:
    """Signals of opposing forces alone, force units, each along `w` recordings; leaves of shape `(k, w, ...)`."""
    places = np.zeros((len(_NEUTRAL), _SLOTS))
    places[list(_NEUTRAL).index("opposing"), 0] = 1.0
    empty = [np.zeros_like(force)] * (_SLOTS - 1)
    return Signals((force, *empty), np.broadcast_to(places, (*force.shape[:2], *places.shape)))


class ModelVariables(eqx.Module):
    """Inputs and variables of a model at one sample or along one recording, `(n,)`, whatever effects the model has.

    **Attributes:** `u` (recorded input), `push` (motor force) and its `rise` within a sample, `x`, `v`, `z`
    (LuGre's bristle), `spring` (its force), `level` (G), `w` (velocity of the bristles), `fast` (that at which
    LuGre's slips), `lost` (its slip, of |fast|), `sigma1`, and `a`, the acceleration.
    """

    u: Float[Array, "*n"]
    push: Float[Array, "*n"]
    rise: Float[Array, "*n"]
    x: Float[Array, "*n"]
    v: Float[Array, "*n"]
    z: Float[Array, "*n"]
    spring: Float[Array, "*n"]
    level: Float[Array, "*n"]
    w: Float[Array, "*n"]
    fast: Float[Array, "*n"]
    lost: Float[Array, "*n"]
    sigma1: Float[Array, "*n"]
    a: Float[Array, "*n"]


def along(drive: Drive, motion: DriveState, u: Float[Array, " n"], dt: Float[Array, ""]) -> ModelVariables:
    """Inputs and variables of `drive` along the states `motion` (arrays of shape `(n, ...)`) for the input `u`, `dt` s
    per sample."""
    bristles = drive.bristles()

    def one(state: DriveState, u, push, rise):
        spring = drive.spring_force(state.bristle)
        now = drive.instant(state.x, state.v, push, spring, state.hidden)
        level, w, fast = drive.level_at(now), drive.bristle_speed(now), drive.slip_speed(now)
        opposing = drive.friction_force(bristles, state.x, state.v, state.z, dt, state.hidden, push)[0]
        lost, a = drive.slip(spring / level, fast), (push - opposing) / drive.J
        sigma1 = drive.sigma1(state.v) + 0.0 * state.v
        return ModelVariables(
            u, push, rise, state.x, state.v, state.bristle, spring, level, w, fast, lost, sigma1, a
        )

    applied = drive.applied_force(u, dt)
    rise = applied.rise if isinstance(applied, Push) else jnp.zeros_like(u)
    return jax.vmap(one)(motion, u, mean_of(applied), rise)


def signals_along(
    friction: LuGre,
    inertia: Float[Array, ""],
    motor_constant: Float[Array, ""],
    effect: AbstractEffect,
    known: ModelVariables,
    dt: Float[Array, ""],
    before: Before,
    samples: Int[Array, ""] | None = None,
) -> Signals:
    """The terms that `effect`, at any strength, would add to a model's equations along a known motion.

    **Arguments:**

    - `friction`, `inertia`, `motor_constant`: of the model.
    - `effect`: the effect.
    - `known`: from `along`.
    - `dt`: s per sample.
    - `before`: history before the first sample.
    - `samples`: as in `scan_samples`.
    """
    n, found = known.u.shape[0], {}
    if isinstance(effect, AbstractInputEffect):
        applied = effect.apply(known.u, dt)
        found["motor_force"] = motor_constant * (mean_of(applied) - known.u)
        if isinstance(applied, Push):
            found["motor_rise"] = motor_constant * applied.rise
    states = effect.states if isinstance(effect, AbstractStateEffect) else 0
    first = (
        effect.initial_states(friction, before) if isinstance(effect, AbstractStateEffect) else jnp.zeros(0)
    )

    def sample(carry, inputs: tuple[ModelVariables, ModelVariables]):
        (hidden, plays, load), (here, there) = carry, inputs
        own, parts = Now(here.x, here.v, here.push, here.spring, hidden), {}
        if isinstance(effect, AbstractForceEffect):
            parts["opposing"] = effect.force(friction, own)
        if isinstance(effect, AbstractLevelEffect):
            parts["level_factor"] = jnp.maximum(effect.level(here.level, friction, own) / here.level, 0.05)
        if isinstance(effect, AbstractSpringEffect):
            parts["bristle_force"] = effect.spring(here.spring, friction, here.z) - here.spring
        if isinstance(effect, AbstractSlipEffect):
            parts["slip_change"] = effect.slip(here.lost, sign(here.fast)) - here.lost
        if isinstance(effect, AbstractDampingEffect):
            parts["damping_factor"] = effect.damping(friction, here.v)
        if isinstance(effect, AbstractCreepEffect):
            parts["bristle_creep"] = effect.bristle_speed(friction, own)
            parts["slip_creep"] = effect.slip_speed(friction, own)
        if isinstance(effect, AbstractBristleEffect):
            share, slack = effect.share_and_yield()
            limit = here.level * slack / friction.sigma0
            moved = jnp.clip(plays + here.w * dt, -limit, limit)
            rate = here.w - jnp.abs(here.fast) * here.lost
            opposing = friction.sigma0 * jnp.sum(share * (plays - here.z))
            opposing = opposing + here.sigma1 * jnp.sum(share * ((moved - plays) / dt - rate))
            parts["opposing"] = parts.get("opposing", 0.0) + opposing
            plays = moved
        if isinstance(effect, AbstractLoadEffect):
            side = effect.load_side()
            a2, touches = contact(side, load)
            free, loss = side.drag * (here.v + load[1]), side.damping * touches
            # Implicit damping: an explicit step of the fastest couplings is unstable.
            faster = load[1] + dt * (a2 - free - here.a) / (1.0 + dt * loss)
            opposing = side.ratio * inertia * ((faster - load[1]) / dt + free)
            parts["opposing"] = parts.get("opposing", 0.0) + opposing
            load = jnp.stack([load[0] + dt * faster, faster])
        if isinstance(effect, AbstractStateEffect):
            # Mean source and rate over the sample, as in the model itself.
            source, rate = effect.relax(friction, own)
            ahead = Now(there.x, there.v, here.push, there.spring, relaxed(hidden, source, rate, dt))
            source_1, rate_1 = effect.relax(friction, ahead)
            hidden = relaxed(hidden, 0.5 * (source + source_1), 0.5 * (rate + rate_1), dt)
        # A constant becomes a signal as well.
        parts = {name: part + 0.0 * here.x for name, part in parts.items()}
        return (hidden, plays, load), (parts, own.hidden)

    count = effect.count if isinstance(effect, AbstractBristleEffect) else 0
    carry = (first, jnp.zeros(count), jnp.zeros(2))
    if states or count or isinstance(effect, AbstractLoadEffect):
        after = jax.tree.map(lambda signal: jnp.append(signal[1:], signal[-1]), known)
        parts, hidden = scan_samples(sample, carry, (known, after), samples)
    else:
        # Without memory the samples are independent.
        parts, hidden = jax.vmap(lambda here: sample(carry, (here, here))[1])(known)
    if isinstance(effect, AbstractSensorEffect):
        t = jnp.arange(n, dtype=known.x.dtype) * dt
        found["sensor_error"] = jax.vmap(effect.measured)(known.x, t, hidden) - known.x
    return _signals(found | parts, n)


def injected_innovations(
    drives: Drive,
    signals: Signals,
    force: Float[Array, "r n"] | Push,
    x: Float[Array, "r n"],
    dt: Float[Array, " r"],
    gains: ObserverGains,
    start: Starts,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, "k r n"]:
    """Innovations of the observer with effects' `signals` in the equations of `k` drives, in each of `r` recordings.

    **Arguments:** leaves of `drives` have the shape `(k, ...)`, those of `signals` `(k, r, ...)`; `force` is that of
    the drives without the effects, the same for all; the others as in `innovations_side_by_side`.
    """
    count, recordings = start[2].shape
    rows, begin = start_rows(drives, start[2], start)
    slots, places = jax.tree.map(
        lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), (signals.slots, signals.places)
    )

    def step(fixed, state, shared, slots):
        (drive, places, dt), (push, measured, t, gains) = fixed, shared
        parts = Signals(slots, places).parts(slots)
        rise = parts.pop("motor_rise") + (push.rise if isinstance(push, Push) else 0.0)
        push = Push(mean_of(push) + parts.pop("motor_force"), rise)
        measured = measured - parts.pop("sensor_error")
        now = drive.with_effects(Injection(**parts))
        return innovation_step(now, dt, substeps)(state, (push, measured, t, gains))

    t = jnp.arange(x.shape[1], dtype=x.dtype)[None] * dt[:, None]
    shared = (force, x, t, gains.along(*x.shape))
    found = rows_along(step, count, (rows, places, tiled(dt, count)), begin, shared, slots, samples)
    return found.reshape(count, recordings, -1)
