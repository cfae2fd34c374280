"""The three-regime experiment: noise in stick, a ramp through break-away, sliding moves; open or closed loop."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from frictionjax import Drive, LuGre, Recording, excitation
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import advance

RATE, SAMPLES = 2000.0, 3000
LABELS = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
ARM = (0.03, 2000.0, 5.0, 0.06, 0.45, 0.62, 0.02)
"""A rotary arm like the paper's: project-chosen numbers, kg m^2, N m/rad, N m s/rad (2), N m (2), rad/s."""
FINE = 2
"""Steps a sample, of data, bound and fits alike: the study is about the estimator. What the step itself does to a fit
is in `benchmarks accuracy`; on free runs as sensitive as these it would be more than the noise."""


class Loop(NamedTuple):
    """A PD controller: bandwidth (Hz) of the closed loop if there were no friction."""

    bandwidth: float = 8.0


def drive_of(theta) -> Drive:
    """The drive with parameters `theta`, shape (7,), in the order of `LABELS`."""
    return Drive(theta[0], LuGre(*(theta[i] for i in range(1, 7))))


def planned(theta) -> tuple[np.ndarray, np.ndarray]:
    """Forces, shape (3, n), of the open-loop experiments, and the reference of the closed-loop moves, shape (n,)."""
    J, _, _, sigma2, Fc, Fs, vs = (float(value) for value in theta)
    t = np.arange(SAMPLES) / RATE
    noise = np.asarray(excitation.prbs(jax.random.key(7), SAMPLES, RATE, 500.0, 0.25 * Fs))
    ramp = 1.3 * Fs * np.minimum(t / 1.2, 1.0) * np.where(t < 1.2, 1.0, 0.0)
    # Moves to and fro with flats at several speeds: force of inertia, of Coulomb and viscous friction.
    speed = 15.0 * vs * np.sin(2 * np.pi * t / 0.75) * (1.0 + 0.6 * np.sin(2 * np.pi * t / 1.5))
    acceleration = np.gradient(speed, 1.0 / RATE)
    moves = J * acceleration + Fc * np.tanh(speed / vs) + sigma2 * speed
    return np.stack([noise, ramp, 1.1 * moves]), np.cumsum(speed) / RATE


@eqx.filter_jit
def _measured(drive, forces, reference, gains, noise, push, closed):
    """Inputs and measured positions, shape (3, n) each, for noise and push already drawn, shape (3, n)."""
    bristles = drive.bristles()

    def sample(carry, inputs):
        state, before = carry
        force, wanted, rate, own, unmeasured, regulated = inputs
        seen = state.x + own
        control = gains[0] * (wanted - seen) + gains[1] * (rate - (seen - before) * RATE)
        u = jnp.where(regulated, control, force)
        return (advance(drive, bristles, state, u + unmeasured, 1.0 / RATE, FINE), seen), (u, seen)

    def one(force, wanted, own, unmeasured, regulated):
        rate = jnp.gradient(wanted) * RATE
        first = (initial_state(drive, 0.0, 0.0, 0.0), own[0])
        kind = jnp.full(force.shape, regulated)
        return jax.lax.scan(sample, first, (force, wanted, rate, own, unmeasured, kind))[1]

    wanted = jnp.stack([0.0 * reference, 0.0 * reference, reference])
    regulated = jnp.asarray([False, False, True]) & closed
    return jax.vmap(one)(forces, wanted, noise, push, regulated)


def draw(theta, keys, noise: float, push: float, *, closed: bool) -> list[list[Recording]]:
    """A set of three recordings for each of `keys`: position noise of standard deviation `noise`, and an unmeasured
    force of `push`, held over each sample."""
    drive = drive_of(theta)
    forces, reference = planned(theta)
    omega = 2.0 * np.pi * Loop().bandwidth
    gains = jnp.asarray([float(theta[0]) * omega**2, 1.4 * float(theta[0]) * omega])

    @jax.jit
    def all_of(keys):
        def one(key):
            first, second = jax.random.split(key)
            own = noise * jax.random.normal(first, forces.shape)
            other = push * jax.random.normal(second, forces.shape)
            return _measured(drive, jnp.asarray(forces), jnp.asarray(reference), gains, own, other, closed)

        return jax.lax.map(one, keys, batch_size=64)

    u, x = (np.asarray(part) for part in all_of(keys))
    names = ("stick noise", "break-away", "moves")
    loops = ("open", "open", "closed" if closed else "open")
    return [
        [Recording(name, RATE, u[d, i], x[d, i], loop=loops[i]) for i, name in enumerate(names)]
        for d in range(len(u))
    ]


def bound(theta, inputs, noise: float) -> np.ndarray:
    """Cramer-Rao bound of each parameter, relative, shape (7,), for white noise and no unmeasured force.

    Free runs on the recorded `inputs`, shape (3, n); the state at the start of each recording is unknown too, with a
    standard deviation of half a break-away deflection for the bristle, as in the fit.
    """
    start = jnp.zeros(9)

    def positions(logs, first):
        drive = drive_of(jnp.asarray(theta) * jnp.exp(logs))
        bristles, yields = drive.bristles(), drive.friction.Fs / drive.friction.sigma0
        scale = float(theta[6])

        def one(u, own):
            state = initial_state(drive, own[0] * noise, own[1] * scale, own[2] * yields)
            return jax.lax.scan(
                lambda s, f: (advance(drive, bristles, s, f, 1.0 / RATE, FINE), s.x), state, u
            )[1]

        return jax.vmap(one)(jnp.asarray(inputs), first.reshape(3, 3))

    by_logs, by_start = (
        np.asarray(part) for part in jax.jit(jax.jacfwd(positions, argnums=(0, 1)))(jnp.zeros(7), start)
    )
    columns = np.concatenate([by_logs, by_start], axis=-1).reshape(-1, 16) / noise
    information = columns.T @ columns
    information[np.arange(9, 16, 3), np.arange(9, 16, 3)] += 4.0
    size = np.sqrt(np.diag(information))
    return np.sqrt(np.diag(np.linalg.inv(information / np.outer(size, size))))[:7] / size[:7]


def apart(theta) -> np.ndarray:
    """Static friction above Coulomb friction."""
    theta = np.array(theta, dtype=float)
    theta[5] = max(theta[5], 1.002 * theta[4])
    return theta
