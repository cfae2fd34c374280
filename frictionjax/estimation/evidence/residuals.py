"""Standardised prediction errors of a whole batch: innovations, or errors of the force under an imposed motion."""

import equinox as eqx
import jax
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import AbstractBatch, Batch
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.physics import Drive
from frictionjax.simulation import Gains, innovation_gain, innovations
from frictionjax.simulation.lanes import innovations_side_by_side


def standardised(
    drive: Drive,
    z0: Float[Array, " r"],
    batch: AbstractBatch,
    gains: Gains,
    *,
    finer: int = 1,
) -> Float[Array, "r n"]:
    """Prediction errors over what the noise alone makes of them: 1 in the mean square for a perfect model, at any
    sample rate; 0 where not scored. Shape `(r, n)`.

    Of a `Batch` they are the innovations of an observer; of an `ImposedBatch` measured less modelled force, with no
    observer: the states follow the imposed motion.

    **Arguments:**

    - `drive`: the `Drive`.
    - `z0`: bristle deflection at the first sample over the break-away deflection Fs/sigma0, shape `(r,)`.
    - `batch`: the recordings.
    - `gains`: observer gains, one per recording, shape `(r,)`; without meaning for an `ImposedBatch`.
    - `finer`: times as many integration steps a sample as the `substeps` of the batch; without meaning for an
      `ImposedBatch`.
    """
    deflection = z0 * drive.friction.Fs / drive.friction.sigma0
    if isinstance(batch, ImposedBatch):
        errors = batch.force - batch.run(drive, deflection)[2]
        return errors / (batch.ease * batch.noise)[:, None] * batch.valid
    return _innovations(drive, deflection, batch, gains, finer)


def standardised_lanes(
    drives: Drive, z0: Float[Array, "k r"], batch: AbstractBatch, gains: Gains
) -> Float[Array, "k r n"]:
    """The `standardised` errors of `k` drives side by side; the leaves of `drives` have the shape `(k, ...)`."""
    if isinstance(batch, ImposedBatch):
        return jax.vmap(lambda drive, deflection: standardised(drive, deflection, batch, gains))(drives, z0)
    assert isinstance(batch, Batch)
    deflection = z0 * (drives.friction.Fs / drives.friction.sigma0)[:, None]
    start = (batch.x0, batch.v0, deflection, batch.before)
    raw = innovations_side_by_side(drives, batch.u, batch.x, batch.dt, gains, start, substeps=batch.substeps)
    return raw / (batch.noise * innovation_gain(gains))[None, :, None] * batch.valid[None]


def _innovations(drive: Drive, deflection, batch, gains: Gains, finer: int):
    assert isinstance(batch, Batch)
    substeps = finer * batch.substeps

    def one(u, x, dt, gains, start):
        return innovations(drive, drive.applied_force(u, dt), x, dt, gains, start, substeps=substeps)

    raw = batch.each(one, gains, deflection)
    return raw / (batch.noise * innovation_gain(gains))[:, None] * batch.valid


def block_power(e: Float[Array, "r n"], batch: AbstractBatch) -> Float[Array, "r b"]:
    """Mean square of the standardised errors in each block, shape `(r, b)`."""
    return batch.block_mean(e * e)


@eqx.filter_jit
def lane_powers(e: Float[Array, "k r n"], batch: AbstractBatch) -> Float[Array, "k r b"]:
    """The `block_power` of several lanes of errors."""
    return jax.vmap(lambda lane: block_power(lane, batch))(e)
