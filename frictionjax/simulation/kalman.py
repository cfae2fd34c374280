"""Extended Kalman filter along a recording: the gains for which innovations are white under measurement noise and a
small unmeasured force.

    x_meas = x + n,  n ~ (0, noise^2);   J x'' = km u - F + d,  d ~ (0, disturbance^2), held over each sample

The covariance goes through the linearised step, P+ = A P A' + b b' disturbance^2 (Jazwinski, Stochastic Processes and
Filtering Theory, 1970, ch. 8). Without the force the gains vanish with time and the prediction is a free run; in stick
the bristles' stiffness restrains the machine and they are small; in sliding they are those of a free mass.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.ros2 import State, Substeps, advance
from frictionjax.simulation.samples import scan_samples

_NEGLIGIBLE, _TINY = 1e-200, 1e-100  # of a covariance, and of a variance that is divided by, in any units

# The creep of a vibrating bristle keeps its direction for many samples: as white noise it needs a larger variance. With
# 30 times its variance the innovations of a machine in stick are white (tests/estimation/test_fit.py), with 10 the
# filter diverges.
_CREEP_VARIANCE = 30.0


class Filtered(eqx.Module):
    """Gains and innovations of the filter along one recording.

    **Attributes:** `gain` of each state (x, v, bristles, states of effects) at each sample, shape `(n, m)`;
    `variance` of the innovation, position units squared, and the `innovation`, position units, shape `(n,)`.
    """

    gain: Float[Array, "n m"]
    variance: Float[Array, " n"]
    innovation: Float[Array, " n"]


def _flat(state: State) -> Float[Array, " m"]:
    return jnp.concatenate([state.x[None], state.v[None], state.z, state.hidden])


def _measured(drive: Drive, flat: Float[Array, " m"], t: Float[Array, ""]) -> Float[Array, ""]:
    """Output of the sensor of the `drive` in a flat state."""
    return drive.measured(flat[0], t, flat[2 + drive.bristle_count :])


def _flat_step(
    drive: Drive, dt: Float[Array, ""], substeps: Substeps
) -> Callable[[Float[Array, " m"], Float[Array, ""] | Push], Float[Array, " m"]]:
    """One sample of the `drive` on flat states: (state, force) -> state."""
    bristles, count = drive.bristles(), drive.bristle_count

    def step(flat, push):
        state = State(flat[0], flat[1], flat[2], flat[3 : 2 + count], flat[2 + count :])
        return _flat(advance(drive, bristles, state, push, dt, substeps, exact_derivative=False))

    return step


def kalman_filter(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    noise: Float[Array, ""],
    disturbance: Float[Array, ""],
    start: Start,
    start_std: tuple[Float[Array, ""], Float[Array, ""]],
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Filtered:
    """Run the filter along one recording; for use inside compiled functions.

    **Arguments:**

    - `drive`: the `Drive`.
    - `force`: motor force held over each sample, shape `(n,)`.
    - `x`: measured position, shape `(n,)`.
    - `dt`: s per sample.
    - `noise`: standard deviation of the measured position, position units.
    - `disturbance`: standard deviation of the unmeasured force, force units.
    - `start`: position, velocity and bristle deflection at the first sample; `start_std`: the standard deviations of
        the first two.
    - `substeps`: integration steps per sample.
    - `samples`: as in `scan_samples`.
    """
    step = _flat_step(drive, dt, substeps)
    first = _flat(state_at(drive, start))
    size, bristles = first.shape[0], drive.bristle_count
    directions = jnp.eye(size + 1)
    covariance = jnp.zeros((size, size)).at[0, 0].set(start_std[0] ** 2).at[1, 1].set(start_std[1] ** 2)

    def sample(carry, inputs):
        state, covariance = carry
        motor, measured, t = inputs
        predicted, row = jax.value_and_grad(lambda flat: _measured(drive, flat, t))(state)
        cross = covariance @ row
        variance = row @ cross + noise**2
        gain = cross / variance
        innovation = measured - predicted
        state = state + gain * innovation
        covariance = covariance - gain[:, None] * cross[None]
        # A deflected bristle creeps under vibration, by |v| S/G, which the step linearised at rest lacks. The mean of
        # |v| less |mean of v| counts as process noise of the bristle.
        spring = drive.spring_force(state[2])
        now = drive.instant(state[0], state[1], mean_of(motor), spring, state[2 + bristles :])
        bend = spring / drive.level_at(now)
        v_std = jnp.sqrt(jnp.maximum(covariance[1, 1], 0.0) + _TINY)
        off = jnp.abs(state[1]) / v_std
        above = v_std * 2.0 * (jax.scipy.stats.norm.pdf(off) - off * jax.scipy.stats.norm.cdf(-off))
        creep = _CREEP_VARIANCE * (bend * dt * above) ** 2
        covariance = covariance.at[2 : 2 + bristles, 2 : 2 + bristles].add(creep)

        def disturbed(state, unmeasured):
            return step(state, motor + unmeasured)

        state, columns = jax.vmap(
            lambda way: jax.jvp(disturbed, (state, 0.0), (way[:size], way[size])), out_axes=(None, 0)
        )(directions)
        moved = columns[:size].T
        covariance = (
            moved @ covariance @ moved.T + disturbance**2 * columns[size][:, None] * columns[size][None]
        )
        covariance = 0.5 * (covariance + covariance.T)
        # In sliding the bristle's covariance decays within a few samples, to denormal numbers, with which a processor
        # is a hundred times slower.
        covariance = jnp.where(jnp.abs(covariance) > _NEGLIGIBLE, covariance, 0.0)
        return (state, covariance), (gain, variance, innovation)

    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    return Filtered(*scan_samples(sample, (first, covariance), (force, x, t), samples))


def _along(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    given: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    substeps: Substeps,
    samples: Int[Array, ""] | None,
    correct: Callable[[Float[Array, ""], Float[Array, ""]], tuple[Float[Array, ""], Float[Array, ""]]],
) -> Float[Array, " n"]:
    """Run with given gains; `correct(predicted position, given)` is (innovation, output): the outputs, shape `(n,)`."""
    step = _flat_step(drive, dt, substeps)

    def sample(state, inputs):
        motor, own, weight, t = inputs
        innovation, output = correct(_measured(drive, state, t), own)
        return step(state + weight * innovation, motor), output

    t = jnp.arange(given.shape[0], dtype=given.dtype) * dt
    return scan_samples(sample, _flat(state_at(drive, start)), (force, given, gain, t), samples)


def predicted_with(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Innovations x - x_predicted along one recording for given gains, position units, shape `(n,)`.

    **Arguments:** `gain` as in `Filtered`, shape `(n, m)`; the others as in `kalman_filter`.
    """
    return _along(
        drive,
        force,
        x,
        dt,
        gain,
        start,
        substeps,
        samples,
        lambda predicted, own: (own - predicted, own - predicted),
    )


def driven_by(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    innovation: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    *,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
) -> Float[Array, " n"]:
    """Positions for which `predicted_with` returns these innovations, position units, shape `(n,)`: its inverse.

    **Arguments:** `innovation`: position units, shape `(n,)`; the others as in `predicted_with`.
    """
    return _along(
        drive,
        force,
        innovation,
        dt,
        gain,
        start,
        substeps,
        samples,
        lambda predicted, own: (own, predicted + own),
    )
