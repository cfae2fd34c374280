"""Extended Kalman filter along a recording: the gains that make prediction errors white under measurement noise and a
small unmeasured force.

    x_meas = x + n,  n ~ (0, noise^2);   J x'' = km u - F + d,  d ~ (0, push^2), held over each sample

The covariance goes through the linearised step, P+ = A P A' + b b' push^2 (Jazwinski, Stochastic Processes and
Filtering Theory, 1970, ch. 8). Without the force the gains vanish with time and the prediction is a free run; in stick
the machine's own spring holds it and they are small; in sliding they are those of a free mass.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.physics import Drive, Push, mean_of
from frictionjax.simulation.fixed import Start, state_at
from frictionjax.simulation.ros2 import State, advance

_NOTHING, _TINY = 1e-200, 1e-100  # of a covariance, and of a variance that is divided by, in any units


# The creep of a shaken bristle goes one way for long: as a noise that is new at each sample it must be larger. At 30
# times its variance the innovations of a held machine are white (tests/test_estimation_fit.py), at 10 the filter is
# lost.
_LASTING = 30.0


class Filtered(eqx.Module):
    """What the filter found along one recording.

    **Attributes:** `gain` of each state (x, v, bristles, states of effects) at each sample, shape `(n, m)`;
    `variance` of the innovation, position units squared, and the `innovation`, position units, shape `(n,)`.
    """

    gain: Float[Array, "n m"]
    variance: Float[Array, " n"]
    innovation: Float[Array, " n"]


def _flat(state: State) -> Float[Array, " m"]:
    return jnp.concatenate([state.x[None], state.v[None], state.z, state.hidden])


def _seen(drive: Drive, flat: Float[Array, " m"], t: Float[Array, ""]) -> Float[Array, ""]:
    """What the sensor of the `drive` shows in a flat state."""
    return drive.seen(flat[0], t, flat[2 + drive.bristle_count :])


def _following(
    drive: Drive, dt: Float[Array, ""], substeps: int
) -> Callable[[Float[Array, " m"], Float[Array, ""] | Push], Float[Array, " m"]]:
    """One sample of the `drive` on flat states: (state, force) -> state."""
    bristles, count = drive.bristles(), drive.bristle_count

    def step(flat, push):
        state = State(flat[0], flat[1], flat[2 : 2 + count], flat[2 + count :])
        return _flat(advance(drive, bristles, state, push, dt, substeps, exact_derivative=False))

    return step


def kalman_filter(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    noise: Float[Array, ""],
    push: Float[Array, ""],
    start: Start,
    spread: tuple[Float[Array, ""], Float[Array, ""]],
    *,
    substeps: int = 1,
) -> Filtered:
    """Run the filter along one recording; for use inside compiled functions.

    **Arguments:**

    - `drive`: the `Drive`.
    - `force`: motor force held over each sample, shape `(n,)`.
    - `x`: measured position, shape `(n,)`.
    - `dt`: s per sample.
    - `noise`: standard deviation of the measured position, position units.
    - `push`: standard deviation of the unmeasured force, force units.
    - `start`: position, velocity and bristle deflection at the first sample; `spread`: the standard deviations of
        the first two.
    - `substeps`: integration steps per sample.
    """
    following = _following(drive, dt, substeps)
    first = _flat(state_at(drive, start))
    size, bristles = first.shape[0], drive.bristle_count
    directions = jnp.eye(size + 1)
    known = jnp.zeros((size, size)).at[0, 0].set(spread[0] ** 2).at[1, 1].set(spread[1] ** 2)

    def sample(carry, inputs):
        state, covariance = carry
        motor, measured, t = inputs
        predicted, row = jax.value_and_grad(lambda flat: _seen(drive, flat, t))(state)
        told = covariance @ row
        variance = row @ told + noise**2
        gain = told / variance
        innovation = measured - predicted
        state = state + gain * innovation
        covariance = covariance - gain[:, None] * told[None]
        # A bent bristle that is shaken creeps, by |v| S/G: at rest the linearised step knows nothing of that. By how
        # much the mean of |v| is above |mean of v| counts as a noise of the bristle.
        spring = drive.spring_force(state[2])
        now = drive.instant(state[0], state[1], mean_of(motor), spring, state[2 + bristles :])
        bend = spring / drive.level_at(now)
        spread = jnp.sqrt(jnp.maximum(covariance[1, 1], 0.0) + _TINY)
        off = jnp.abs(state[1]) / spread
        above = spread * 2.0 * (jax.scipy.stats.norm.pdf(off) - off * jax.scipy.stats.norm.cdf(-off))
        creep = _LASTING * (bend * dt * above) ** 2
        covariance = covariance.at[2 : 2 + bristles, 2 : 2 + bristles].add(creep)

        def shaken(state, unmeasured):
            return following(state, motor + unmeasured)

        state, columns = jax.vmap(
            lambda way: jax.jvp(shaken, (state, 0.0), (way[:size], way[size])), out_axes=(None, 0)
        )(directions)
        moved = columns[:size].T
        covariance = moved @ covariance @ moved.T + push**2 * columns[size][:, None] * columns[size][None]
        covariance = 0.5 * (covariance + covariance.T)
        # In sliding the bristle forgets in a few samples: its covariance would go on through the denormal numbers, in
        # which a processor counts a hundred times slower.
        covariance = jnp.where(jnp.abs(covariance) > _NOTHING, covariance, 0.0)
        return (state, covariance), (gain, variance, innovation)

    return Filtered(
        *jax.lax.scan(sample, (first, known), (force, x, jnp.arange(x.shape[0], dtype=x.dtype) * dt))[1]
    )


def _along(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    given: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    substeps: int,
    tell: Callable[[Float[Array, ""], Float[Array, ""]], tuple[Float[Array, ""], Float[Array, ""]]],
) -> Float[Array, " n"]:
    """What `tell(predicted position, given)` says at each sample as (innovation, output): the outputs, shape `(n,)`."""
    following = _following(drive, dt, substeps)

    def sample(state, inputs):
        motor, own, weight, t = inputs
        innovation, output = tell(_seen(drive, state, t), own)
        return following(state + weight * innovation, motor), output

    t = jnp.arange(given.shape[0], dtype=given.dtype) * dt
    return jax.lax.scan(sample, _flat(state_at(drive, start)), (force, given, gain, t))[1]


def predicted_with(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    x: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    *,
    substeps: int = 1,
) -> Float[Array, " n"]:
    """Innovations x - x_predicted along one recording for given gains, position units, shape `(n,)`.

    **Arguments:** `gain` as in `Filtered`, shape `(n, m)`; the others as in `kalman_filter`.
    """
    return _along(drive, force, x, dt, gain, start, substeps, lambda seen, own: (own - seen, own - seen))


def driven_by(
    drive: Drive,
    force: Float[Array, " n"] | Push,
    innovation: Float[Array, " n"],
    dt: Float[Array, ""],
    gain: Float[Array, "n m"],
    start: Start,
    *,
    substeps: int = 1,
) -> Float[Array, " n"]:
    """Positions of which `predicted_with` makes these innovations, position units, shape `(n,)`: its inverse.

    **Arguments:** `innovation`: position units, shape `(n,)`; the others as in `predicted_with`.
    """
    return _along(drive, force, innovation, dt, gain, start, substeps, lambda seen, own: (own, seen + own))
