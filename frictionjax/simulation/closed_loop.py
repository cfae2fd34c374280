"""`simulate_closed_loop`: free run of a drive under its controller, which answers to the simulated position."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float, Int, Real

from frictionjax.core import require_x64
from frictionjax.core.programs import Jitted
from frictionjax.core.safe import real
from frictionjax.physics import Drive, mean_of
from frictionjax.physics.effects import AbstractInputEffect, Before
from frictionjax.recordings import Controller
from frictionjax.simulation.fixed import Start, Trajectory, state_at, trajectory_of
from frictionjax.simulation.ros2 import Substeps, advance
from frictionjax.simulation.samples import scan_samples

# Samples of the input that a delay or a lag of the drive may still depend on: each of them is computed again at every
# sample. A quarter of a second at 1 kHz, 26 ms at 10 kHz: longer than what a fast loop tolerates.
_REMEMBERED = 256


def run_closed(
    drive: Drive,
    controller: Controller,
    reference: Float[Array, " n"],
    feedforward: Float[Array, " n"],
    dt: Float[Array, ""],
    every: Int[Array, ""],
    start: Start,
    substeps: Substeps,
    samples: Int[Array, ""] | None = None,
) -> Trajectory:
    """Closed-loop run of `drive`, for use inside compiled functions.

    The integrator stops where it would drive the input further beyond its limit. Before the first sample the input is
    taken to have been the feedforward at it; what it was more than 256 samples ago no longer matters to the drive.

    **Arguments:** `controller`: its gains and limit; `reference` (position units), `feedforward` (input units), shape
    `(n,)`; `every`: samples from one of the controller's to the next; the others as in `run_free`.
    """
    bristles, period = drive.bristles(), every.astype(float) * dt
    slow = drive.hold == "linear" or any(isinstance(one, AbstractInputEffect) for one in drive.effects)

    def limited(u: Float[Array, "*d"]) -> Float[Array, "*d"]:
        return jnp.clip(u, -controller.limit, controller.limit)

    def sample(carry, inputs):
        state, integral, last, answer, past = carry
        number, wanted, given, following = inputs
        off = wanted - drive.measured(state.x, number.astype(float) * dt, state.hidden)
        due = number % every == 0
        step = controller.ki * off * period
        asked = controller.kp * off + integral + step + controller.kd * (off - last) / period
        answer = jnp.where(due, asked, answer)
        beyond = given + answer - limited(given + answer)
        integral = integral + jnp.where(due & (beyond * step <= 0.0), step, 0.0)
        u = limited(given + answer)
        past = jnp.append(past[1:], u)
        # An input that is not held runs to what it will be at the next sample, as far as that is known by now.
        around = jnp.append(past, limited(following + answer))
        push = jax.tree.map(lambda one: one[-2], drive.applied_force(around, dt))
        ahead = advance(drive, bristles, state, push, dt, substeps)
        return (ahead, integral, jnp.where(due, off, last), answer, past), (state, u, mean_of(push))

    begin = state_at(drive, start)
    first = reference[0] - drive.measured(begin.x, 0.0 * dt, begin.hidden)
    zero = jnp.zeros_like(first)
    past = jnp.full(_REMEMBERED if slow else 1, feedforward[0])
    inputs = (
        jnp.arange(reference.shape[0]),
        reference,
        feedforward,
        jnp.append(feedforward[1:], feedforward[-1:]),
    )
    run, u, push = scan_samples(sample, (begin, zero, first, zero, past), inputs, samples)
    return dataclasses.replace(trajectory_of(drive, run, push, dt, substeps), u=u)


_simulate = Jitted(run_closed)


def control_samples(controller: Controller, sample_rate: float) -> tuple[int, int]:
    """How the `controller` samples a recording of this `sample_rate` (Hz): into how many parts each sample of the
    recording must be cut, and how many of these there are from one of the controller's samples to the next."""
    if controller.rate is None:
        return 1, 1
    finer = max(round(controller.rate / sample_rate), 1)
    return finer, max(round(finer * sample_rate / controller.rate), 1)


def finer_samples(
    values: Float[np.ndarray, " n"], parts: int, *, held: bool = False
) -> Float[np.ndarray, " m"]:
    """`values` with each sample cut into so many `parts`: `held`, or on the line to the next."""
    if parts == 1:
        return values
    if held:
        return np.repeat(values, parts)
    places = np.arange(values.size * parts) / parts
    return np.interp(places, np.arange(values.size), values)


def simulate_closed_loop(
    drive: Drive,
    reference: Real[ArrayLike, "..."],
    sample_rate: float,
    controller: Controller,
    *,
    feedforward: Real[ArrayLike, "..."] = 0.0,
    x0: Real[ArrayLike, ""] = 0.0,
    v0: Real[ArrayLike, ""] = 0.0,
    z0: Real[ArrayLike, ""] = 0.0,
    substeps: int = 2,
    before: Before | None = None,
) -> Trajectory:
    """Simulate `drive` under a `controller` that makes its position follow a `reference`. Works under jit, vmap and
    grad of the drive, the gains and the limit.

    Given the measured position as `reference` and the recorded input as `feedforward`, this is the closed-loop free run
    of a recording, whatever its reference was: the controller is linear, so that it answers to the difference alone.

    **Arguments:**

    - `drive`: the `Drive`.
    - `reference`: position to follow, shape `(n,)`, position units.
    - `sample_rate`: samples per second. A faster controller is simulated at its own rate.
    - `controller`: the `Controller`.
    - `feedforward`: input to which the controller adds, shape `(n,)` or a number, input units.
    - `x0`, `v0`, `z0`: position, velocity and bristle deflection at the first sample.
    - `substeps`: steps per sample, see `simulate`.
    - `before`: history before the first sample, for effects with memory (dwell, warm-up).

    **Returns:**

    A `Trajectory`, whose `u` is what the controller gave.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `ValueError` for shapes other than these.
    """
    require_x64()
    path, added = np.asarray(reference, float), np.asarray(feedforward, float)
    if path.ndim != 1 or added.shape not in ((), path.shape):
        raise ValueError(
            f"`reference` has shape {path.shape} and `feedforward` {added.shape}; `simulate_closed_loop` takes one "
            "reference of shape (n,), and a feedforward of that shape or a number."
        )
    parts, every = control_samples(controller, sample_rate)
    path = finer_samples(path, parts)
    added = finer_samples(np.broadcast_to(added, (path.size // parts,)), parts, held=drive.hold == "zero")
    start = (real(x0), real(v0), real(z0), Before() if before is None else before)
    dt = 1.0 / (sample_rate * parts)
    run = _simulate(
        drive, controller, real(path), real(added), real(dt), jnp.asarray(every), start, int(substeps)
    )
    return jax.tree.map(lambda one: one[::parts], run)
