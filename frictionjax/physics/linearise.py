"""Linearisation (3)-(4), with Clarke's generalized Jacobian at rest."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Real

from frictionjax.core import require_x64
from frictionjax.core.safe import real
from frictionjax.physics.drive import Drive


class Linearization(eqx.Module):
    """The linearised drive, equations (3) and (4).

    **Attributes:**

    - `left`, `right`: Jacobians of d/dt (x, v, z_1 ... z_n) for v -> 0- and v -> 0+, shape `(2 + n, 2 + n)`. They
      are the ends of the generalized Jacobian (a convex hull); at z = 0 they coincide.
    - `stiffness`, `damping`: sigma0 (of the whole bank) and sigma1 + sigma2 in force/position and force s/position,
      for the mean of the two ends.
    - `natural_frequency` (Hz), `damping_ratio`.
    - `unique`: True when left and right coincide, so that the generalized Jacobian is one matrix.
    """

    left: Float[Array, "s s"]
    right: Float[Array, "s s"]
    stiffness: Float[Array, ""]
    damping: Float[Array, ""]
    natural_frequency: Float[Array, ""]
    damping_ratio: Float[Array, ""]
    unique: Bool[Array, ""]


def linearize(
    drive: Drive, *, x: Real[ArrayLike, ""] = 0.0, z: Real[ArrayLike, ""] | Real[ArrayLike, " n"] = 0.0
) -> Linearization:
    """Linearise the drive at rest (v = 0). States of slow effects, such as creep, are constant: the result is the
    instantaneous response.

    **Arguments:**

    - `drive`: the `Drive`.
    - `x`: position, position units.
    - `z`: deflection of the bristle, or of each of the n elements, position units.

    **Returns:**

    A `Linearization`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64.
    """
    require_x64()
    return _linearize(drive, real(x), real(z))


@eqx.filter_jit
def _linearize(drive: Drive, x: Float[Array, ""], z: Float[Array, ""] | Float[Array, " n"]) -> Linearization:
    bristles = drive.bristles()
    deflection = jnp.broadcast_to(z, (drive.bristle_count,))

    def one_sided(direction):
        def field(state):
            position, speed, elements = state[0], state[1], state[2:]
            # |v| = direction * v on this side of rest: an exact one-sided derivative, nothing is smoothed.
            # An element at its yield slips when the motion continues, and sticks when it reverses.
            level = drive.level(position, direction * 1e-300 + 0.0 * speed)
            sigma0 = drive.friction.sigma0
            sticks = jnp.where(direction * elements < bristles.limit(level, sigma0), direction, 0.0)
            bend = drive.slip(drive.spring_force(elements[0]) / level, direction * jnp.ones(()))
            slip = bristles.rate(direction * jnp.ones(()), direction * jnp.ones(()), bend, sticks)
            rate = speed * direction * slip
            now = drive.instant(position, direction * 1e-300 + speed, 0.0, drive.spring_force(elements[0]))
            force = drive.opposing_force(bristles, now, elements, rate)
            return jnp.concatenate([jnp.stack([speed, -force / drive.J]), rate])

        return jax.jacfwd(field)(jnp.concatenate([jnp.stack([x, 0.0 * x]), deflection]))

    left, right = one_sided(-1.0), one_sided(1.0)
    middle = 0.5 * (left + right)
    stiffness = -drive.J * (middle[1, 0] + jnp.sum(middle[1, 2:] * middle[2:, 1]))
    damping = -drive.J * middle[1, 1]
    return Linearization(
        left=left,
        right=right,
        stiffness=stiffness,
        damping=damping,
        natural_frequency=jnp.sqrt(stiffness / drive.J) / (2.0 * jnp.pi),
        damping_ratio=0.5 * damping / jnp.sqrt(stiffness * drive.J),
        unique=jnp.all(jnp.abs(left - right) <= 1e-12 * (1.0 + jnp.abs(right))),
    )
