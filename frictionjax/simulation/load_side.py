"""A second inertia behind a coupling, and states that relax: shared by the integration schemes.

d = x2 - x1,  w = d',   x2'' = a2(d, w) - D x2',   x1'' = f/J1 - (J2/J1) a2,   a2 = -K dz(d) - C w (in contact)
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.physics import Drive
from frictionjax.physics.effects.base import LoadSide


def relaxed(
    hidden: Float[Array, " m"],
    source: Float[Array, " m"],
    rate: Float[Array, " m"],
    h: Float[Array, ""],
) -> Float[Array, " m"]:
    """States `hidden` after `h` s of h' = source - rate h: exact for constant `source` and `rate` (1/s)."""
    path = rate * h
    small = path < 1e-6
    kept = jnp.where(small, 1.0 - 0.5 * path, -jnp.expm1(-path) / jnp.where(small, 1.0, path))
    return hidden + (source - rate * hidden) * h * kept


def contact(side: LoadSide, load: Float[Array, " 2"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Acceleration a2 of the second inertia `side` by its coupling in the state `load` (d, w), and whether there is
    contact (1 or 0)."""
    # Without a gap, d = 0 is in contact like any other d: jnp.clip would halve its derivative there.
    inside = jnp.abs(load[0]) < side.half_gap
    beyond = jnp.where(inside, 0.0, load[0] - jnp.sign(load[0]) * side.half_gap)
    pull = -side.stiffness * beyond - side.damping * load[1]
    # The flanks of a gap push and never pull: the contact opens when its damper would pull.
    apart = inside | ((pull * load[0] > 0.0) & (side.half_gap > 0.0))
    return jnp.where(apart, 0.0, pull), jnp.where(apart, 0.0, 1.0)


def two_inertias(
    drive: Drive, force: Float[Array, ""], v: Float[Array, ""], load: Float[Array, " m"]
) -> tuple[Float[Array, ""], Float[Array, " m"]]:
    """Acceleration of the motor at velocity `v` under the `force` of motor and friction, and rates of the
    `load` states (d, w), of shape `(2,)`; `(0,)` where there is no second inertia."""
    side = drive.load_side
    if side is None:
        return force / drive.J, load
    a2, _ = contact(side, load)
    a1 = (force / drive.J - side.ratio * a2) / (1.0 - side.ratio)
    return a1, jnp.stack([load[1], a2 - side.drag * (v + load[1]) - a1])
