"""Bristle deflection at the first sample of recordings that a model has not been fitted to."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.residuals import block_power, standardised, weights
from frictionjax.physics import Drive
from frictionjax.simulation import Gains

_STEPS = 4


@eqx.filter_jit
def fit_deflections(
    drive: Drive, batch: Batch, gains: Gains
) -> tuple[Float[Array, " r"], Float[Array, "r n"]]:
    """Starting deflections (over Fs/sigma0, in [-1, 1]) by robust Gauss-Newton, and the innovations they leave.

    **Arguments:**

    - `drive`: the model, nothing of which is changed.
    - `batch`: the recordings, `r` of them.
    - `gains`: observer gains, shape `(r,)`.

    **Returns:**

    Deflections, shape `(r,)`, and standardised innovations, shape `(r, n)`.
    """

    def errors(z0):
        return standardised(drive, z0, batch, gains)

    def step(z0, _):
        e, column = jax.jvp(errors, (z0,), (jnp.ones_like(z0),))
        weight = weights(block_power(e, batch), jnp.ones(()), batch)
        # The prior of half a break-away deflection keeps a recording without stick at rest.
        slope = jnp.sum(weight * column * e, axis=1) + 4.0 * z0
        change = slope / (jnp.sum(weight * column * column, axis=1) + 4.0)
        return jnp.clip(z0 - change, -1.0, 1.0), None

    z0, _ = jax.lax.scan(step, jnp.zeros_like(batch.x0), None, length=_STEPS)
    return z0, errors(z0)
