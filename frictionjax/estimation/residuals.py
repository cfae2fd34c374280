"""Standardised innovations of a whole batch, and the robust likelihood built on them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.physics import Drive
from frictionjax.simulation import Gains, innovation_gain, innovations


def standardised(
    drive: Drive, z0: Float[Array, " r"], batch: Batch, gains: Gains, *, substeps: int = 1
) -> Float[Array, "r n"]:
    """Innovations over what the noise alone makes of them: 1 in the mean square for a perfect model, at any sample
    rate; 0 where not scored. Shape `(r, n)`.

    **Arguments:**

    - `drive`: the `Drive`.
    - `z0`: bristle deflection at the first sample over the break-away deflection Fs/sigma0, shape `(r,)`.
    - `batch`: the `Batch`.
    - `gains`: observer gains, one per recording, shape `(r,)`.
    - `substeps`: integration steps per sample.
    """
    deflection = z0 * drive.friction.Fs / drive.friction.sigma0

    def one(u, x, dt, position_gain, velocity_gain, x0, v0, z, before):
        return innovations(
            drive,
            drive.applied_force(u, dt),
            x,
            dt,
            Gains(position_gain, velocity_gain),
            (x0, v0, z, before),
            substeps=substeps,
        )

    raw = jax.vmap(one)(
        batch.u,
        batch.x,
        batch.dt,
        gains.position,
        gains.velocity,
        batch.x0,
        batch.v0,
        deflection,
        batch.before,
    )
    return raw / (batch.noise * innovation_gain(gains))[:, None] * batch.valid


def block_power(e: Float[Array, "r n"], batch: Batch) -> Float[Array, "r b"]:
    """Mean square of the standardised innovations in each block, shape `(r, b)`."""
    return batch.block_mean(e * e)


def weights(power: Float[Array, "r b"], knee: Float[Array, ""], batch: Batch) -> Float[Array, "r n"]:
    """Weight of each sample, 1 / (block power + knee^2): the re-weighting of the block-wise Cauchy likelihood."""
    weight = 1.0 / (power + knee * knee)
    return jnp.repeat(weight, batch.block, axis=-1) * batch.valid


@eqx.filter_jit
def mismatch(power: Float[Array, "r b"], floor: Float[Array, ""], batch: Batch) -> Float[Array, ""]:
    """Mean per sample of 1/2 log((block power + floor) / (2 floor)): 0 when every block is at the `floor` (1: noise).

    The block-wise Cauchy likelihood: every block counts by its relative error.
    """
    count = batch.block_count
    return 0.5 * jnp.sum(count * jnp.log((power + floor) / (2.0 * floor))) / jnp.sum(count)
