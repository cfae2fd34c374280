"""An observer with given gains: innovations of a drive whose state is corrected by the measurement.

One formula serves stick and sliding, open and closed loop: only the recorded input enters. With white
measurement noise and the true model, the root mean square of the innovation is a constant of the method times the
noise (`innovation_gain`), so that the innovation of a complete model has a known size.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Array, Bool, Float, Int

from frictionjax.core.arrays import Numbers, known
from frictionjax.core.programs import compiled
from frictionjax.physics import Drive, Push
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.load_side import contact
from frictionjax.simulation.ros2 import DriveState, Substeps, advance
from frictionjax.simulation.samples import scan_samples


class ObserverGains(eqx.Module):
    """Gains of the observer: of the position, `position` (1), and of the velocity, `velocity` (1/s). Scalars, or one
    per lane, or one per sample."""

    position: Float[Numbers, "..."]
    velocity: Float[Numbers, "..."]

    def along(self, *shape: int) -> "ObserverGains":
        """One per sample, of a `shape` whose last axis is that of the samples; those that are not yet one per sample
        are the same along it."""

        def each(gain: Float[Numbers, "..."]) -> Float[Numbers, "... n"]:
            xp, (gain,) = known(gain)
            return xp.broadcast_to(gain.reshape(*gain.shape, *[1] * (len(shape) - gain.ndim)), shape)

        return ObserverGains(each(self.position), each(self.velocity))


Sample = tuple[Float[Array, ""] | Push, Float[Array, ""], Float[Array, ""], ObserverGains]
"""Motor force, measured position and time of a sample, and the gains there."""


def observer_gains(
    bandwidth: float | Float[Numbers, "..."], dt: float | Float[Numbers, "..."]
) -> ObserverGains:
    """Gains for an observer of `bandwidth` Hz on samples of `dt` s, with a double pole at p = exp(-2 pi bandwidth dt):
    l1 = 1 - p^2, l2 = (1 - p)^2/dt."""
    xp, (bandwidth, dt) = known(bandwidth, dt)
    pole = xp.exp(-2.0 * xp.pi * xp.asarray(bandwidth) * xp.asarray(dt))
    return ObserverGains(xp.asarray(1.0 - pole**2), xp.asarray((1.0 - pole) ** 2 / dt))


def innovation_gain(
    gains: ObserverGains, integrated: Bool[Numbers, "..."] | bool = False
) -> Float[Numbers, "..."]:
    """RMS of the innovation over that of the measurement noise, for a free mass under the true model.

    The norm of (1 - q)^2 / (1 - p q)^2, from white noise to innovation with q the unit delay:
    sqrt(2 (3 + p) / (1 + p)^3). The noise of an integrated velocity is a random walk, whose steps have the power of the
    differences of white noise, sqrt(2) times it: sqrt(2) times the norm of (1 - q) / (1 - p q)^2 is
    2 / sqrt((1 - p) (1 + p)^3).

    **Arguments:** `gains`, from `observer_gains`, of any shape; the gain has the same shape; `integrated`: whether the
    positions are integrated velocities, of that shape, too.
    """
    xp, (position,) = known(gains.position)
    pole = xp.sqrt(1.0 - position)
    white = xp.sqrt(2.0 * (3.0 + pole) / (1.0 + pole) ** 3)
    return xp.asarray(xp.where(integrated, 2.0 / xp.sqrt((1.0 - pole) * (1.0 + pole) ** 3), white))


def sensor_noise(
    white: Float[np.ndarray, "*k rows n"], integrated: Bool[np.ndarray, " rows"]
) -> Float[np.ndarray, "*k rows n"]:
    """The noise of a measured position over its standard deviation, of `white` noise of unit power: that itself, and a
    random walk from zero in the rows where the position is an `integrated` velocity (`innovation_gain`)."""
    walks = np.asarray(integrated)[:, None]
    if not np.any(walks):
        return white
    walk = np.cumsum(white, axis=-1) - white[..., :1]
    return np.where(walks, np.sqrt(2.0) * walk, white)


def left_by_observer(x: Float[np.ndarray, "rows n"], gains: ObserverGains) -> Float[np.ndarray, "rows n"]:
    """What an observer that expects every machine to keep its speed leaves of positions `x`: (1 - q)^2 / (1 - p q)^2 of
    them, with q the unit delay, which is the acceleration over its memory. `gains` of shape `(rows,)`.
    """
    poles = np.sqrt(1.0 - np.asarray(gains.position))
    pairs = zip(poles, x, strict=True)
    return np.stack(
        [scipy.signal.lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole, pole**2], own) for pole, own in pairs]
    )


@compiled()
def left_by_varying_observer(
    x: Float[Numbers, "rows n"], gains: ObserverGains, dt: Float[Numbers, " rows"]
) -> Float[Array, "rows n"]:
    """The same of positions `x` with `gains` that vary along the recordings, shape `(rows, n)`; `dt` s a sample."""

    def one(x: Float[Array, " n"], gains: ObserverGains, dt: Float[Array, ""]) -> Float[Array, " n"]:
        def sample(
            state: tuple[Float[Array, ""], Float[Array, ""]],
            now: tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]],
        ) -> tuple[tuple[Float[Array, ""], Float[Array, ""]], Float[Array, ""]]:
            (position, velocity), (measured, of_position, of_velocity) = state, now
            left = measured - position
            velocity = velocity + of_velocity * left
            return (position + of_position * left + dt * velocity, velocity), left

        first = (x[0], jnp.zeros_like(x[0]))
        return jax.lax.scan(sample, first, (x, gains.position, gains.velocity))[1]

    return jax.vmap(one)(jnp.asarray(x), gains, jnp.asarray(dt))


class ObservedMotion(eqx.Module):
    """Innovations and predicted states, before each correction; shape `(n,)` (`z`: `(n, bristles)`).

    **Attributes:** `innovation` x_measured - x_predicted, and the prediction: `x`, `v`, `z`, and `hidden`,
    the states of effects.
    """

    innovation: Float[Array, " n"]
    x: Float[Array, " n"]
    v: Float[Array, " n"]
    z: Float[Array, "n bristles"]
    hidden: Float[Array, "n m"]


def corrected(
    drive: Drive,
    slack: Float[Array, " n"],
    state: DriveState,
    innovation: Float[Array, ""],
    gains: ObserverGains,
) -> DriveState:
    """State after the correction by one innovation; `slack` as in `Bristles`.

    The gains apply to the sensor's output and to the velocity. The error of a lagging sensor grows with velocity: its
    states are corrected to their steady values for the corrected velocity, and the position by the same amount more.
    Correcting the position alone would put the lag into the observer's loop and change the innovations of white noise
    (`innovation_gain`).
    """
    faster, further, hidden = gains.velocity * innovation, gains.position * innovation, state.hidden
    if drive.sensor_has_states:
        hidden = hidden + drive.sensor_states(faster)
        start = jnp.zeros_like(state.x)
        further = (
            further + drive.measured(state.x, start, state.hidden) - drive.measured(state.x, start, hidden)
        )
    x, v = state.x + further, state.v + faster
    if drive.sensor_integrates:
        # What the integral has drifted is no motion: the bristles stay as they are.
        return DriveState(x, v, state.bristle, state.elements, _load_carried(drive, hidden, further, faster))
    # In stick the bristle moves with the machine and is corrected with it; a slipping bristle is not. The level is
    # that at this velocity: with Fs instead, sliding bristles would be corrected too, and a model with a narrow peak of
    # static friction would gain a faster observer.
    spring = drive.spring_force(state.bristle)
    level = drive.level_at(drive.instant(x, v, 0.0, spring, state.hidden))
    # LuGre's bristle follows with the part of the motion that is not slip, whatever the law of slip.
    stuck = jnp.maximum(0.0, 1.0 - jnp.abs(drive.slip(spring / level, v)))
    bent = jnp.abs(state.elements) / (slack[1:] * level / drive.friction.sigma0)
    elements = state.elements + further * jnp.maximum(0.0, 1.0 - bent)
    hidden = _load_carried(drive, hidden, further, faster)
    return DriveState(x, v, state.bristle + further * stuck, elements, hidden)


def _load_carried(
    drive: Drive, hidden: Float[Array, " m"], further: Float[Array, ""], faster: Float[Array, ""]
) -> Float[Array, " m"]:
    """The `hidden` states when the motor is corrected by `further` and `faster`: a load in contact goes with it, one
    within a gap stays where it is.

    A load that stays behind pulls the motor back through a stiff or damped coupling before the next sample. Part of the
    correction is lost, the observer gets slower, or unstable, and a second inertia that is not there would be credited
    with the noise that a slower observer lets through less. The twist is not corrected: it decays by itself.
    """
    if drive.load_side is None:
        return hidden
    own, load = hidden[: drive.state_count], hidden[drive.state_count :]
    _, touching = contact(drive.load_side, load)
    return jnp.concatenate([own, load - (1.0 - touching) * jnp.stack([further, faster])])


def corrected_states(drive: Drive, observed: ObservedMotion, gains: ObserverGains) -> DriveState:
    """The states after each correction: what `observed` predicted, corrected by its innovation with `gains`.

    **Returns:**

    A `DriveState` of arrays of shape `(n,)` (`z`: `(n, bristles)`), for the `drive` that the observer ran with.
    """
    slack = drive.bristles().slack

    def correct(innovation, x, v, z, hidden, gains):
        return corrected(drive, slack, DriveState(x, v, z[0], z[1:], hidden), innovation, gains)

    every = gains.along(*observed.x.shape)
    return jax.vmap(correct)(observed.innovation, observed.x, observed.v, observed.z, observed.hidden, every)


def observe(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: ObserverGains,
    start: Start,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> ObservedMotion:
    """Run the observer along one recording.

    **Arguments:**

    - `drive`: the `Drive`.
    - `force`: motor force held over each sample, shape `(n,)` (`drive.applied_force(u, dt)`).
    - `x`: measured position, shape `(n,)`.
    - `dt`: s per sample.
    - `gains`: from `observer_gains`, or one per sample.
    - `start`: position, velocity and bristle deflection at the first sample.
    - `substeps`: integration steps per sample.
    - `samples`: as in `scan_samples`.

    **Returns:**

    An `ObservedMotion`.
    """
    bristles = drive.bristles()

    def sample(state, inputs):
        push, measured, t, here = inputs
        innovation = measured - drive.measured(state.x, t, state.hidden)
        state_now = corrected(drive, bristles.slack, state, innovation, here)
        following = advance(drive, bristles, state_now, push, dt, substeps)
        return following, (innovation, state.x, state.v, state.z, state.hidden)

    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    inputs = (force, x, t, gains.along(*x.shape))
    return ObservedMotion(*scan_samples(sample, state_at(drive, start), inputs, samples))


def innovations(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gains: ObserverGains,
    start: Start,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """The innovations of `observe` alone, shape `(n,)`, as fits and tests use them.

    **Arguments:** `drive`, `force`, `x`, `dt`, `gains`, `start`, `substeps`, `samples` as in `observe`.
    """
    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    step = innovation_step(drive, dt, substeps)
    return scan_samples(step, state_at(drive, start), (force, x, t, gains.along(*x.shape)), samples)


def innovation_step(
    drive: Drive, dt: Float[Array, ""], substeps: Substeps
) -> Callable[[DriveState, Sample], tuple[DriveState, Float[Array, ""]]]:
    """One sample of `innovations`: (state, `Sample`) -> (state, innovation)."""
    bristles = drive.bristles()

    def sample(state, inputs):
        push, measured, t, gains = inputs
        innovation = measured - drive.measured(state.x, t, state.hidden)
        state_now = corrected(drive, bristles.slack, state, innovation, gains)
        return advance(drive, bristles, state_now, push, dt, substeps, exact_derivative=False), innovation

    return sample
