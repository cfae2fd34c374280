"""Standardised innovations of a whole batch."""

import jax
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
