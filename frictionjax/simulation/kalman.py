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
from jaxtyping import Array, Bool, Float, Int

from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.ros2 import DriveState, Substeps, advance
from frictionjax.simulation.samples import scan_samples

_NEGLIGIBLE, _TINY = 1e-200, 1e-100  # of a covariance, and of a variance that is divided by, in any units

# The creep of a vibrating bristle keeps its direction for many samples: as white noise it needs a larger variance. With
# 30 times its variance the innovations of a machine in stick are white (tests/estimation/test_fit.py), with 10 the
# filter diverges.
_CREEP_VARIANCE = 30.0
_MEMORY = 10.0  # samples over which innovations are compared with their variance
_LOST = 9.0  # mean square over that variance, from which the filter has lost the machine: three standard deviations


class Filtered(eqx.Module):
    """Gains and innovations of the filter along one recording.

    **Attributes:** `gain` of each state (x, v, bristles, states of effects) at each sample, shape `(n, m)`;
    `variance` of the innovation, position units squared, and the `innovation`, position units, shape `(n,)`.
    """

    gain: Float[Array, "n m"]
    variance: Float[Array, " n"]
    innovation: Float[Array, " n"]


def _flat(state: DriveState) -> Float[Array, " m"]:
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
        state = DriveState(flat[0], flat[1], flat[2], flat[3 : 2 + count], flat[2 + count :])
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
    integrated: Bool[Array, ""] | bool = False,
    substeps: Substeps = 1,
    samples: Int[Array, ""] | None = None,
    recovers: bool = False,
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
    - `integrated`: whether `x` is an integrated velocity. Its noise is a random walk, whose steps have twice the power
        of `noise`: that of the position itself, as the filter sees it.
    - `substeps`: integration steps per sample.
    - `samples`: as in `scan_samples`.
    - `recovers`: whether the filter finds back to a machine that it has lost. Near break-away a machine that moves may
        be taken for one in stick: the covariance shrinks, and nothing is corrected any more. Where the squares of ten
        innovations are nine times their variance in the mean, position and velocity are as uncertain as the last one
        says (cf. strong tracking filters, Zhou and Frank, Int. J. Control 63, 1996). The `variance` is that without it.
    """
    step = _flat_step(drive, dt, substeps)
    first = _flat(state_at(drive, start))
    size, bristles = first.shape[0], drive.bristle_count
    directions = jnp.eye(size + 1)
    white, walk = jnp.where(integrated, 0.0, 1.0) * noise**2, jnp.where(integrated, 2.0, 0.0) * noise**2
    covariance = jnp.zeros((size, size)).at[0, 0].set(start_std[0] ** 2).at[1, 1].set(start_std[1] ** 2)

    def corrected(covariance, row):
        """Gain, variance of the innovation, and the covariance after the measurement."""
        cross = covariance @ row
        variance = row @ cross + white
        gain = cross / variance
        return gain, variance, covariance - gain[:, None] * cross[None]

    def sample(carry, inputs):
        state, covariance, alone = carry
        motor, measured, t = inputs
        predicted, row = jax.value_and_grad(lambda flat: _measured(drive, flat, t))(state)
        innovation = measured - predicted
        surprise = None
        if alone is None:
            gain, variance, covariance = corrected(covariance, row)
            own = None
        else:
            own, surprise = alone
            expected = row @ covariance @ row + white
            surprise = surprise + (innovation**2 / expected - surprise) / _MEMORY
            more = jnp.where(surprise > _LOST, innovation**2, 0.0)
            surprise = jnp.where(surprise > _LOST, 1.0, surprise)
            covariance = covariance.at[0, 0].add(more).at[1, 1].add(more / (_MEMORY * dt) ** 2)
            _, variance, own = corrected(own, row)
            gain, _, covariance = corrected(covariance, row)
        state = state + gain * innovation
        # A deflected bristle creeps under vibration, by |v| S/G, which the step linearised at rest lacks. The mean of
        # |v| less |mean of v| counts as process noise of the bristle.
        spring = drive.spring_force(state[2])
        now = drive.instant(state[0], state[1], mean_of(motor), spring, state[2 + bristles :])
        bend = spring / drive.level_at(now)
        before = state

        def disturbed(state, unmeasured):
            return step(state, motor + unmeasured)

        state, columns = jax.vmap(
            lambda way: jax.jvp(disturbed, (state, 0.0), (way[:size], way[size])), out_axes=(None, 0)
        )(directions)
        moved = columns[:size].T

        def advanced(covariance):
            v_std = jnp.sqrt(jnp.maximum(covariance[1, 1], 0.0) + _TINY)
            off = jnp.abs(before[1]) / v_std
            above = v_std * 2.0 * (jax.scipy.stats.norm.pdf(off) - off * jax.scipy.stats.norm.cdf(-off))
            creep = _CREEP_VARIANCE * (bend * dt * above) ** 2
            covariance = covariance.at[2 : 2 + bristles, 2 : 2 + bristles].add(creep)
            covariance = (
                moved @ covariance @ moved.T + disturbance**2 * columns[size][:, None] * columns[size][None]
            )
            covariance = (0.5 * (covariance + covariance.T)).at[0, 0].add(walk)
            # In sliding the bristle's covariance decays within a few samples, to denormal numbers, with which a
            # processor is a hundred times slower.
            return jnp.where(jnp.abs(covariance) > _NEGLIGIBLE, covariance, 0.0)

        alone = None if own is None else (advanced(own), surprise)
        return (state, advanced(covariance), alone), (gain, variance, innovation)

    t = jnp.arange(x.shape[0], dtype=x.dtype) * dt
    # The covariance without recovery, and the mean square of the last innovations over their variance.
    alone = (covariance, jnp.ones(())) if recovers else None
    return Filtered(*scan_samples(sample, (first, covariance, alone), (force, x, t), samples))


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
