"""Residual force: the force missing from a model, estimated from the position by a disturbance observer."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.physics import Drive, Push
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.observer import ObserverGains, corrected
from frictionjax.simulation.ros2 import Substeps, advance
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
        kept = state.hidden
        state = corrected(drive, bristles.slack, state, innovation, gains)
        share = drive.J
        if drive.load_side is not None:
            # The load goes with the motor: the twist then decays by itself, whatever the coupling, and the poles stay
            # where they are. Corrected alone, the motor is pulled back by its load before the next sample.
            own, twist = state.hidden[: drive.state_count], kept[drive.state_count :]
            moved = jnp.stack([-0.5 * dt, jnp.ones_like(dt)]) * missing * dt
            state = eqx.tree_at(lambda whole: whole.hidden, state, jnp.concatenate([own, twist + moved]))
            share = drive.J * (1.0 - drive.load_side.ratio)
        return (advance(drive, bristles, state, push + share * missing, dt, substeps), missing), missing

    first = (state_at(drive, start), jnp.zeros_like(dt))
    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    missing = scan_samples(sample, first, (force, x, t), samples)
    lag = jnp.round(3.0 * pole / (1.0 - pole)).astype(int)
    end = x.shape[0] if measured is None else measured
    later = jnp.clip(jnp.arange(x.shape[0]) + lag, 0, end - 1)
    return drive.J * missing[later]


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
