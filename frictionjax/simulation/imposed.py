"""`simulate_imposed`: the friction force of a drive whose motion is imposed, as on a tribometer.

For a known motion the friction level G is known at every step, and each bristle obeys (2) on its own,

    dz/dt = |v| (S(y) - S(z))/G,    S(y) = G sgn v,

S the bristle's spring force and y its deflection in steady sliding. With k the secant stiffness between z and y, and y
linear over a step of path d, this is solved exactly:

    a = k |d| mean(1/G),   z+ = z + (1 - e^-a) (y0 - z) + (1 - (1 - e^-a)/a) (y1 - y0)

For the linear spring k = sigma0, and the step is exact at constant velocity; else k is the mean of the secants at both
ends, second order. z+ lies between z, y0 and y1: stable at any |v| sigma0 h/G, and never beyond them. |v| is not
smoothed. A law p(S/G) of slip in place of S/G makes k = G (sgn v - p)/(y - z). States of effects take Heun's step
around it; a level that depends on them is evaluated at both ends of that step. Effects of the input, of the motor force
and of the sensor, and a second inertia, do not act under an imposed motion.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int, Real

from frictionjax.core import InputError, require_x64
from frictionjax.core.safe import real, sign
from frictionjax.physics import Bristles, Drive
from frictionjax.physics.effects.base import (
    AbstractLevelEffect,
    AbstractSpringEffect,
    AbstractStateEffect,
    Before,
)
from frictionjax.simulation.fixed import Trajectory
from frictionjax.simulation.load_side import relaxed
from frictionjax.simulation.ros2 import LARGEST_YIELD
from frictionjax.simulation.samples import scan_samples

_REST = 1e-30  # a velocity that counts as rest and has a direction


class _Step(NamedTuple):
    """A step: its length `h`; at both ends (2,) position, velocity, velocity with a direction at rest too, friction
    level and yield deflection of LuGre's bristle."""

    h: Float[Array, "*steps"]
    x: Float[Array, "*steps 2"]
    v: Float[Array, "*steps 2"]
    directed_v: Float[Array, "*steps 2"]
    level: Float[Array, "*steps 2"]
    yields: Float[Array, "*steps 2"]


def _velocities(
    x: Float[Array, " n"], v: Float[Array, " n"] | None, dt: Float[Array, ""]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Velocities on both sides of every sample instant, each of shape (n,)."""
    if v is not None:
        return v, v
    mean = jnp.diff(x) / dt
    change = jnp.pad(jnp.diff(mean), 1)
    left, right = change[:-1], change[1:]
    # Zero where they differ in sign: second order in smooth motion, and exact next to a corner.
    smaller = jnp.where(jnp.abs(left) < jnp.abs(right), left, right)
    rise = 0.5 * jnp.where(left * right > 0.0, smaller, 0.0)
    start, end = mean - rise, mean + rise
    return jnp.concatenate([start[:1], end]), jnp.concatenate([start, end[-1:]])


def _has_spring_effects(drive: Drive) -> bool:
    return any(isinstance(effect, AbstractSpringEffect) for effect in drive.effects)


def _yield_deflection(drive: Drive, level: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Deflection of LuGre's bristle under the force `level`."""
    sigma0, z = drive.friction.sigma0, level / drive.friction.sigma0
    if not _has_spring_effects(drive):
        return z

    def closer(_, z):
        force, slope = jax.jvp(drive.spring_force, (z,), (jnp.ones_like(z),))
        z = z - (force - level) / jax.lax.stop_gradient(jnp.maximum(slope, 0.05 * sigma0))
        return jnp.clip(z, 0.0, LARGEST_YIELD * level / sigma0)

    # A last step from the solution, through which the derivative of the solution passes.
    return closer(0, jax.lax.stop_gradient(jax.lax.fori_loop(0, 8, closer, z)))


def _secant(
    drive: Drive, z: Float[Array, ""], y: Float[Array, ""], level: Float[Array, ""]
) -> Float[Array, ""]:
    """Secant stiffness of LuGre's bristle from the deflection `z` to `y`, its deflection under `level`."""
    towards = sign(y)

    def lost(z):
        return level * drive.slip(drive.spring_force(z) / level, towards)

    force, slope = jax.jvp(lost, (y,), (jnp.ones_like(y),))
    near = jnp.abs(y - z) < 1e-9 * jnp.abs(y)
    rise = (force - lost(z)) / jnp.where(near, 1.0, y - z)
    return jnp.maximum(jnp.where(near, slope, rise), 1e-3 * drive.friction.sigma0)


def _level_depends_on_states(drive: Drive) -> bool:
    """Whether the friction level depends on states of effects, and so is unknown before the run."""
    return any(
        isinstance(effect, AbstractStateEffect) and isinstance(effect, AbstractLevelEffect)
        for effect in drive.effects
    )


def _relaxed(
    z: Float[Array, ""], y0: Float[Array, ""], y1: Float[Array, ""], a: Float[Array, ""]
) -> Float[Array, ""]:
    """LuGre's bristle after a step of `a` relaxation lengths towards a target from `y0` to `y1`."""
    gone = -jnp.expm1(-a)
    small = a < 1e-8
    late = jnp.where(small, 0.5 * a, 1.0 - gone / jnp.where(small, 1.0, a))
    return z + gone * (y0 - z) + late * (y1 - y0)


def _deflected(
    drive: Drive,
    bristles: Bristles,
    z: Float[Array, " bristles"],
    way: Float[Array, ""],
    step: _Step,
    unslipped: Float[Array, ""] | float = 0.0,
) -> Float[Array, " bristles"]:
    """Deflections after the bristles moved by `way`, position units, and, without slip of LuGre's bristle, by
    `unslipped`, half of it before and half of it after."""
    z = jnp.concatenate([z[:1] + 0.5 * unslipped, z[1:]])
    y0, y1 = sign(way) * step.yields
    length = jnp.abs(way) * jnp.mean(1.0 / step.level)
    if not _has_spring_effects(drive) and not drive.has_slip_effects:
        first = _relaxed(z[0], y0, y1, drive.friction.sigma0 * length)
    else:
        stiffness = _secant(drive, z[0], y0, step.level[0])
        guess = _relaxed(z[0], y0, y1, stiffness * length)
        stiffness = 0.5 * (stiffness + _secant(drive, guess, y1, step.level[1]))
        first = _relaxed(z[0], y0, y1, stiffness * length)
    first = first + 0.5 * unslipped
    if z.shape[-1] == 1:
        return first[None]
    limit = step.level[1] * bristles.slack[1:] / drive.friction.sigma0
    return jnp.concatenate([first[None], bristles.cut(z[1:] + way + unslipped, limit)])


def _steps(
    drive: Drive,
    x: tuple[Float[Array, ""], Float[Array, ""]],
    v: tuple[Float[Array, ""], Float[Array, ""]],
    dt: Float[Array, ""],
    substeps: int,
) -> _Step:
    """The steps of a sample, two to a substep, each part of shape (steps,); `x`, `v`: positions and velocities at its
    beginning and at its end.

    A substep is divided where the velocity changes sign, else in its middle, so that no reversal is lost.
    """
    share = jnp.arange(substeps + 1) / substeps

    def both_ends(first, last):
        nodes = first + (last - first) * share
        return nodes[:-1], nodes[1:]

    def pieces(first, middle, last):
        return jnp.reshape(jnp.stack([first, middle, middle, last], axis=-1), (-1, 2))

    (x0, x1), (v0, v1) = both_ends(*x), both_ends(*v)
    turns = v0 * v1 < 0.0
    part = jnp.where(turns, v0 / jnp.where(turns, v0 - v1, 1.0), 0.5)
    h = dt / substeps * jnp.ravel(jnp.stack([part, 1.0 - part], axis=-1))
    velocity = pieces(v0, jnp.where(turns, 0.0, 0.5 * (v0 + v1)), v1)
    # At rest, the level is that of the direction of the step.
    towards = sign(jnp.sum(velocity, axis=-1, keepdims=True))
    directed_v = towards * jnp.maximum(towards * velocity, _REST)
    position = pieces(x0, x0 + (x1 - x0) * part, x1)
    level = jax.vmap(jax.vmap(drive.level))(position, directed_v)
    return _Step(h, position, velocity, directed_v, level, _yield_deflection(drive, level))


def run_imposed(
    drive: Drive,
    x: Real[ArrayLike, " n"],
    dt: Real[ArrayLike, ""],
    z0: Real[ArrayLike, ""],
    *,
    v: Real[ArrayLike, " n"] | None = None,
    substeps: int = 1,
    earlier: Before | None = None,
    samples: Int[Array, ""] | None = None,
) -> tuple[Float[Array, " n"], Float[Array, "n bristles"], Float[Array, " n"]]:
    """Velocity, deflections and friction force of `drive` at every sample of an imposed motion, for use inside compiled
    functions. Arguments as in `imposed_friction`."""
    x, dt, z0, v = real(x), real(dt), real(z0), None if v is None else real(v)
    bristles = drive.bristles()
    # One sample more, at the last velocity, so that a step begins at every sample.
    further = jnp.append(x, 2.0 * x[-1] - x[-2])
    before, after = _velocities(further, None if v is None else jnp.append(v, v[-1]), dt)

    def levelled(step: _Step, ends):
        """`step` with the levels at both of its `ends`: bristle and states of effects."""
        if not _level_depends_on_states(drive):
            return step
        level = jnp.stack(
            [
                drive.level_at(drive.instant(x, v, 0.0, drive.spring_force(z[0]), hidden))
                for x, v, (z, hidden) in zip(step.x, step.directed_v, ends, strict=True)
            ]
        )
        return step._replace(level=level, yields=_yield_deflection(drive, level))

    def motion(step: _Step, end: int, z, hidden):
        """At one `end`: velocity at which LuGre's bristle slips, the additional velocity of all bristles, and the
        relaxation of the states of effects."""
        now = drive.instant(step.x[end], step.v[end], 0.0, drive.spring_force(z[0]), hidden)
        fast = drive.slip_speed(now)
        return fast, drive.bristle_speed(now) - fast, drive.relaxation(now)

    def advance(state, step: _Step):
        z, hidden = state
        h, (v0, v1) = step.h, step.v
        if not drive.state_count:
            return (_deflected(drive, bristles, z, 0.5 * h * (v0 + v1), step), hidden), None
        fast0, more0, flow = motion(step, 0, z, hidden)
        ahead = relaxed(hidden, *flow, h)
        step = levelled(step, [(z, hidden), (z, ahead)])
        guess = _deflected(drive, bristles, z, 0.5 * h * (2.0 * fast0 - v0 + v1), step, h * more0)
        fast1, more1, flow1 = motion(step, 1, guess, ahead)
        source, rate = (0.5 * (one + other) for one, other in zip(flow, flow1, strict=True))
        later = relaxed(hidden, source, rate, h)
        step = levelled(step, [(z, hidden), (guess, later)])
        bent = _deflected(drive, bristles, z, 0.5 * h * (fast0 + fast1), step, 0.5 * h * (more0 + more1))
        return (bent, later), None

    def friction_on_both_sides(x, sides, z, hidden):
        forces = [drive.friction_force(bristles, x, side, z, dt, hidden)[0] for side in sides]
        return sum(forces[1:], forces[0]) / len(forces)

    def sample(state, now):
        """What is measured at a sample, and the state at the next. The friction level is computed here, step by step:
        of the whole motion at once it would be stored with all of its derivatives, which takes longer."""
        (x0, x1), sides, (v0, v1) = now
        found = (state[0], friction_on_both_sides(x0, sides, *state))
        steps = _steps(drive, (x0, x1), (v0, v1), dt, substeps)
        return jax.lax.scan(advance, state, steps)[0], found

    hidden0 = drive.initial_states(Before() if earlier is None else earlier)[: drive.state_count]
    first = (z0 * jnp.ones(drive.bristle_count), hidden0)
    sides = (before[:-1],) if v is not None else (before[:-1], after[:-1])
    along = ((further[:-1], further[1:]), sides, (after[:-1], before[1:]))
    z, friction = scan_samples(sample, first, along, samples)
    return sum(sides[1:], sides[0]) / len(sides), z, friction


def imposed_friction(
    drive: Drive,
    x: Real[ArrayLike, " n"],
    dt: Real[ArrayLike, ""],
    z0: Real[ArrayLike, ""],
    *,
    v: Real[ArrayLike, " n"] | None = None,
    substeps: int = 1,
    earlier: Before | None = None,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Friction force of `drive` at the samples of an imposed motion, for use inside compiled functions.

    One scan of fixed length: differentiable by the parameters and by `z0`, and works under vmap. Nothing is checked.

    **Arguments:** `drive`, `x` (shape `(n,)`, n at least 2), `z0`, `v` and `substeps` as in `simulate_imposed`; `dt`: s
    per sample; `earlier`: history before the first sample, None: power-on and a rest of 1 s; `samples` as in
    `scan_samples`.

    **Returns:** The opposing force, shape `(n,)`, force units.
    """
    return run_imposed(drive, x, dt, z0, v=v, substeps=substeps, earlier=earlier, samples=samples)[2]


@eqx.filter_jit
def _simulate_imposed(
    drive: Drive,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    z0: Float[Array, ""],
    v: Float[Array, " n"] | None,
    substeps: int,
) -> Trajectory:
    v, z, friction = run_imposed(drive, x, dt, z0, v=v, substeps=substeps)
    return Trajectory(jnp.arange(x.shape[0], dtype=x.dtype) * dt, x, v, z, friction, x, substeps)


def simulate_imposed(
    drive: Drive,
    x: Real[ArrayLike, "..."],
    sample_rate: Real[ArrayLike, ""],
    *,
    v: Real[ArrayLike, "..."] | None = None,
    z0: Real[ArrayLike, ""] = 0.0,
    substeps: int = 1,
) -> Trajectory:
    """Friction force of `drive` when its position is imposed: F = sigma0 z + sigma1 dz/dt + sigma2 v, and the effects.

    It opposes the motion; inertia, motor, effects of the input (delay, drive lag), of the motor force and of the sensor
    take no part. Works under jit, vmap and in derivatives. The first sample is the first after power-on, after a rest
    of 1 s.

    Without `v`, the velocity is linear within each sample and its mean is the difference of the positions. Where it
    jumps at a sample, velocity and force are the means of both sides; elsewhere v is the central difference. (The mean
    of an interval, taken for its end, is late by half a sample.) That is without bias to second order in the sample
    time, at both ends of the record to first. Nothing is smoothed: encoder steps q give v steps of q sample_rate / 2,
    to which sigma2 v is blind in the mean; a level that curves within them is flattened, and an `x` that flickers at
    rest relaxes the bristles by 2 q sigma0 z/G each time.

    **Arguments:**

    - `drive`: the `Drive`.
    - `x`: imposed position, shape `(n,)`, position units.
    - `sample_rate`: samples per second.
    - `v`: measured or smoothed velocity, shape `(n,)`, position/s, linear between samples. The bristles then follow it
        alone, and `x` only says where: an offset of `v` bends them.
    - `z0`: deflection of every bristle at the first sample, position units.
    - `substeps`: steps per sample. 1 is exact for LuGre at constant velocity. States of effects need steps below half
        their time constant, creep's over 1 + compliance.

    **Returns:**

    A `Trajectory`, whose first sample has the deflection `z0`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` for a shape of `x` or `v` that does not fit; outside
    compiled functions, `InputError` for a number in `x` or `v` that is not finite and a `sample_rate` not above zero.
    """
    require_x64()
    x, v, rate = real(x), None if v is None else real(v), real(sample_rate)
    if x.ndim != 1 or x.shape[0] < 2:
        raise ValueError(
            f"`x` has shape {x.shape}; `simulate_imposed` takes one motion of shape (n,) with at least 2 samples. "
            "Batch with jax.vmap."
        )
    if v is not None and v.shape != x.shape:
        raise ValueError(f"`v` has shape {v.shape} and `x` {x.shape}: give one velocity for each position.")
    for name, values in (("x", x), ("v", x if v is None else v)):
        if not isinstance(values, Tracer) and not np.all(np.isfinite(values)):
            at = int(np.argmin(np.isfinite(values)))
            cure = "Cut it out, or interpolate over it."
            raise InputError(f"sample {at} is {float(values[at])}", place=f"`{name}`", cure=cure)
    if not isinstance(rate, Tracer) and not 0.0 < float(rate) < np.inf:
        cure = "Give samples per second, above zero."
        raise InputError(f"it is {sample_rate}", place="`sample_rate`", cure=cure)
    return _simulate_imposed(drive, x, 1.0 / rate, real(z0), v, int(substeps))
