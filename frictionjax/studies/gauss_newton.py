"""Gauss-Newton steps of small, badly scaled least-squares problems, thousands of them at once.

A fixed number of steps near a minimum, each taken as it is: no step is judged, so that there is nothing of a fit's
`Stepper` to share.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

DAMPING = 1e-10  # J, Fc and sigma2 differ by one part in 1e8 of a normal matrix
LONGEST = 0.5  # longest step in any logarithm: the linear model is usable within it
ENOUGH = 1e-2  # converged when the predicted decrease is below this many noise variances: a tenth of a standard error


def _scaled(normal: Float[Array, "p p"]) -> tuple[Float[Array, " p"], Float[Array, "p p"]]:
    size = jnp.sqrt(jnp.diagonal(normal))
    size = jnp.where(size > 0.0, size, 1.0)
    return size, normal / size[:, None] / size[None, :]


def step(normal: Float[Array, "p p"], gradient: Float[Array, " p"]) -> Float[Array, " p"]:
    """The Gauss-Newton step `normal^-1 gradient`, cut where it would move a coordinate by more than 0.5.

    Zero where it is not finite.
    """
    size, scaled = _scaled(normal)
    move = jnp.linalg.solve(scaled + DAMPING * jnp.eye(size.size), gradient / size) / size
    move = move * jnp.minimum(1.0, LONGEST / jnp.maximum(jnp.max(jnp.abs(move)), LONGEST))
    return jnp.where(jnp.all(jnp.isfinite(move)), move, 0.0)


def inverse(normal: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Inverse of a `normal` matrix, whose diagonal may span decades."""
    size, scaled = _scaled(normal)
    return jnp.linalg.inv(scaled) / size[:, None] / size[None, :]
