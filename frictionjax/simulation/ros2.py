"""One step of the production scheme: a two-stage Rosenbrock W-method, second order and L-stable.

    (I - g h A) k1 = f(y),   (I - g h A) k2 = f(y + h k1) - 2 k1,   y+ = y + 3/2 h k1 + 1/2 h k2,   g = 1 - 1/sqrt(2)

(Verwer, Spee, Blom, Hundsdorfer 1999). The order does not rest on A, so A holds only what is stiff: the bristles,
their damping and the viscous force. A is an arrow (each bristle meets the others only through v) and is solved by
elimination, whatever the number of bristles. |v| is never smoothed: at rest that would let the bristles creep.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.physics import Bristles, Drive

_GAMMA = 1.0 - 0.5**0.5
# A bristle never bends beyond G/sigma0; this many times Fs/sigma0 is beyond any level that an effect makes of G.
_BENT = 2.5


class State(eqx.Module):
    """State of a drive: position `x`, velocity `v`, bristle deflections `z` of shape `(n,)` (position units, s)."""

    x: Float[Array, ""]
    v: Float[Array, ""]
    z: Float[Array, " n"]


def ros2_step(
    drive: Drive,
    bristles: Bristles,
    state: State,
    force: Float[Array, ""],
    h: Float[Array, ""],
    *,
    exact_derivative: bool = True,
) -> State:
    """Advance `state` by `h` s under the motor force `force`, held over the step.

    Without `exact_derivative` the derivatives of A are left out of what is differentiated. As the order does not rest
    on A, derivatives stay correct to second order in `h`, at less than half the cost: right for the Jacobians of fits.
    """
    friction = drive.friction
    gh = _GAMMA * h
    mobility = 1.0 / drive.J

    def opposing(x, v, z, stick):
        rate = bristles.rate(v, z, drive.level(x, v), friction.sigma0, stick)
        return drive.opposing_force(bristles, x, v, z, rate), rate

    x, v = state.x, state.v
    limit_now = bristles.limit(drive.level(x, v), friction.sigma0)
    z = bristles.within(state.z, limit_now)
    # An elasto-slip element moves with the machine until it yields: its mean velocity over the step has these bounds.
    low, high = (-limit_now - z) / h, (limit_now - z) / h
    stick_now = jnp.clip(v, low, high)
    friction_now, rate_now = opposing(x, v, z, stick_now)
    # Across a velocity reversal the bristle rate, which grows with |v|, may rise from nothing to far beyond 1/h. A is
    # then taken at the speed that the step heads for, if it is the larger one; elsewhere at the present speed, which
    # keeps the step L-stable.
    ahead = v + h * (force - friction_now) * mobility
    fast = jnp.where((ahead * v < 0.0) & (jnp.abs(ahead) > jnp.abs(v)), ahead, v)
    # Columns of A: v moves everything (by forward differentiation), LuGre's z moves its own rate only.
    _, (friction_v, rate_v) = jax.jvp(
        lambda speed: opposing(x, speed, z, jnp.clip(speed, low, high)), (fast,), (jnp.ones_like(v),)
    )
    rate_z = jnp.where(bristles.lugre, -jnp.abs(fast) * (friction.sigma0 / drive.level(x, fast)), 0.0)
    if not exact_derivative:
        friction_v, rate_v, rate_z = jax.lax.stop_gradient((friction_v, rate_v, rate_z))
    acceleration_z = -bristles.share * (friction.sigma0 + friction.sigma1 * rate_z) * mobility
    pivot_z = 1.0 / (1.0 - gh * rate_z)
    arm = gh * acceleration_z * pivot_z
    pivot_v = 1.0 / (1.0 + gh * friction_v * mobility - jnp.sum(arm * gh * rate_v))

    def solve(right_x, right_v, right_z):
        k_v = (right_v + jnp.sum(arm * right_z)) * pivot_v
        return right_x + gh * k_v, k_v, (right_z + gh * rate_v * k_v) * pivot_z

    k1_x, k1_v, k1_z = solve(v, (force - friction_now) * mobility, rate_now)
    x1, v1 = x + h * k1_x, v + h * k1_v
    limit_1 = bristles.limit(drive.level(x1, v1), friction.sigma0)
    middle = 0.5 * (v + v1)
    z1 = jnp.where(bristles.lugre, z + h * k1_z, jnp.clip(z + h * middle, -limit_1, limit_1))
    # Both stages weigh alike: this makes their mean the exact mean, so that the impulse of the damping is exact.
    friction_1, rate_1 = opposing(x1, v1, z1, 2.0 * jnp.clip(middle, low, high) - stick_now)
    k2_x, k2_v, k2_z = solve(
        v1 - 2.0 * k1_x, (force - friction_1) * mobility - 2.0 * k1_v, rate_1 - 2.0 * k1_z
    )
    x2, v2 = x + h * (1.5 * k1_x + 0.5 * k2_x), v + h * (1.5 * k1_v + 0.5 * k2_v)
    z2 = z + h * (1.5 * k1_z + 0.5 * k2_z)
    # A step across a reversal at a bristle rate far above 1/h can throw LuGre's bristle further than it can bend. What
    # is too much is taken back, and with it the blow that its damping gave the mass: J v + sigma1 z stays as it was.
    bound = _BENT * friction.Fs / friction.sigma0
    bound = jax.lax.stop_gradient(bound)
    excess = jnp.where(bristles.lugre, z2 - jax.lax.clamp(-bound, z2, bound), 0.0)
    v2 = v2 + friction.sigma1 * jnp.sum(bristles.share * excess) * mobility
    z2 = jnp.where(bristles.lugre, z2 - excess, jnp.clip(z + (x2 - x), -limit_1, limit_1))
    return State(x2, v2, z2)


def advance(
    drive: Drive,
    bristles: Bristles,
    state: State,
    force: Float[Array, ""],
    dt: Float[Array, ""],
    substeps: int,
    *,
    exact_derivative: bool = True,
) -> State:
    """Advance by one sample of `dt` s in `substeps` equal steps; see `ros2_step`."""
    if substeps == 1:
        return ros2_step(drive, bristles, state, force, dt, exact_derivative=exact_derivative)
    h = dt / substeps

    def part(_, now):
        return ros2_step(drive, bristles, now, force, h, exact_derivative=exact_derivative)

    return jax.lax.fori_loop(0, substeps, part, state)
