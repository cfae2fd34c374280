"""Residual force: the force missing from a model, estimated from the position by a disturbance observer."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.physics import Drive, Push
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.load_side import contact
from frictionjax.simulation.observer import ObserverGains, corrected
from frictionjax.simulation.ros2 import DriveState, Substeps, advance
from frictionjax.simulation.samples import scan_samples


def residual_force(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    bandwidth: float | Float[Array, ""],
    start: Start,
    *,
    substeps: Substeps = 1,
    measured: Int[Array, ""] | int | None = None,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Force that `drive` lacks at each instant, shape `(n,)`, force units: J x'' = km u - F + residual force.

    An observer with a triple pole at p = exp(-2 pi bandwidth dt) has the missing acceleration as a state
    (gains 1 - p^3, 3/2 (1 - p)^2 (1 + p)/dt, (1 - p)^3/dt^2); a shift removes its lag, that of three poles. The
    last samples, beyond the end of the shifted signal, repeat the last value. Of two coupled inertias it acts on both,
    in proportion.

    **Arguments:**

    - `drive`: the model.
    - `force`: motor force held over each sample, shape `(n,)`.
    - `x`: measured position, shape `(n,)`.
    - `dt`: s per sample.
    - `bandwidth`: Hz; lower is smoother.
    - `start`: position, velocity and bristle deflection at the first sample.
    - `substeps`: integration steps per sample.
    - `measured`: number of measured samples, where `x` is padded behind them; None: all.
    - `samples`: as in `scan_samples`.
    """
    bristles = drive.bristles()
    pole = jnp.exp(-2.0 * jnp.pi * bandwidth * dt)
    gains = ObserverGains(1.0 - pole**3, 1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / dt)
    gain = (1.0 - pole) ** 3 / dt**2

    def sample(carry, inputs):
        state, missing = carry
        push, position, t = inputs
        innovation = position - drive.measured(state.x, t, state.hidden)
        missing = missing + gain * innovation
        state = corrected(drive, bristles.slack, state, innovation, gains)
        state, share = _moved(drive, state, missing, dt)
        return (
            advance(drive, bristles, state, push + share * drive.J * missing, dt, substeps),
            missing,
        ), missing

    first = (state_at(drive, start), jnp.zeros_like(dt))
    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    missing = scan_samples(sample, first, (force, x, t), samples)
    lag = jnp.round(3.0 * pole / (1.0 - pole)).astype(int)
    end = x.shape[0] if measured is None else measured
    later = jnp.clip(jnp.arange(x.shape[0]) + lag, 0, end - 1)
    return drive.J * missing[later]


def _moved(
    drive: Drive, state: DriveState, missing: Float[Array, ""], dt: Float[Array, ""]
) -> tuple[DriveState, Float[Array, ""]]:
    """The `state` in which a load that is in contact has the `missing` acceleration of a sample of `dt` s, too, and the
    share of the inertia that is left for the motor to be accelerated by."""
    if drive.load_side is None:
        return state, jnp.ones_like(dt)
    own, load = state.hidden[: drive.state_count], state.hidden[drive.state_count :]
    _, touching = contact(drive.load_side, load)
    ahead = touching * missing * dt * jnp.stack([-0.5 * dt, jnp.ones_like(dt)])
    hidden = jnp.concatenate([own, load + ahead])
    return eqx.tree_at(lambda whole: whole.hidden, state, hidden), 1.0 - drive.load_side.ratio


def residual_force_std(noise: float, inertia: float, dt: float, bandwidth: float) -> float:
    """Standard deviation of `residual_force` under white position noise and the true model, force units.

    From noise to missing acceleration: g (1 - q)^2 / (1 - p q)^3 with q the unit delay; for a free mass.

    **Arguments:** `noise` (position units), `inertia`, `dt` (s), `bandwidth` (Hz).
    """
    p = float(np.exp(-2.0 * np.pi * bandwidth * dt))
    frequency = np.linspace(0.0, np.pi, 20001)
    q = np.exp(-1j * frequency)
    power = np.abs((1.0 - p) ** 3 / dt**2 * (1.0 - q) ** 2 / (1.0 - p * q) ** 3) ** 2
    return noise * inertia * float(np.sqrt(np.trapezoid(power, frequency) / np.pi))
