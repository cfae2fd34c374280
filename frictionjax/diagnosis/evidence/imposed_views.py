"""What a model predicts along imposed motions, where the measured response is a force.

The motion is given, so that nothing drifts and a free run is the prediction. Actuator, inertia and position sensor play
no part.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.core.programs import compiled
from frictionjax.diagnosis.evidence.judgement import Judgement
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.data.pieces import pieces_of, put_together
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation.imposed import run_imposed

_HALF_POWER = 0.443  # of a moving average: its width times the frequency at which it passes half the power


class ForceView(eqx.Module):
    """One model's predictions along imposed motions, arrays of shape `(r, n)`: the force of a `free` run from the first
    measured force, and `ahead` by 0.1 s; the force that it lacks, `missing` (smoothed); `v` (its mean over a block),
    `bend` (|z| over Fs/sigma0) and the standardised errors `e`."""

    free: Float[np.ndarray, "r n"]
    ahead: Float[np.ndarray, "r n"]
    missing: Float[np.ndarray, "r n"]
    v: Float[np.ndarray, "r n"]
    bend: Float[np.ndarray, "r n"]
    e: Float[np.ndarray, "r n"]


@compiled()
def _runs(
    drive: Drive, batch: ImposedBatch, deflection: Float[Numbers, " r"]
) -> tuple[Float[Numbers, "r n"], ...]:
    most = drive.friction.Fs / drive.friction.sigma0

    def first_deflection(
        x: Float[Numbers, " n"], force: Float[Numbers, " n"], dt: Float[Numbers, ""], earlier: Before
    ) -> Float[Numbers, ""]:
        # The force is linear in the deflection, also where the recording begins in motion: there the bristles' damping
        # belongs to it.
        low, high = (
            run_imposed(drive, x[:2], dt, side * most, earlier=earlier)[2][0] for side in (-1.0, 1.0)
        )
        rise = high - low
        flat = jnp.abs(rise) < 1e-9 * drive.friction.Fs
        part = (force[0] - low) / jnp.where(flat, 1.0, rise)
        return most * jnp.where(flat, 0.0, jnp.clip(2.0 * part - 1.0, -1.0, 1.0))

    first = jax.vmap(first_deflection)(batch.x, batch.force, batch.dt, batch.before)
    v, z, friction = batch.along(drive, deflection * most)
    return batch.along(drive, first)[2], friction, v, jnp.abs(z[..., 0]) / most


def view_of_forces(judgement: Judgement, batch: ImposedBatch, horizon: int, bandwidth: float) -> ForceView:
    """Predict the recordings of `batch` by the model of the `judgement`.

    `ahead` is the force of the model plus its mean error over `horizon` samples that ended `horizon` samples before.

    **Arguments:** `horizon`: samples; `bandwidth`: of the missing force, Hz.
    """
    pieces = pieces_of(batch.lengths)
    found = [
        _runs(judgement.drive, batch.piece(piece), judgement.deflection[piece.lanes]) for piece in pieces
    ]
    free, friction, v, bend = (
        put_together(list(zip(pieces, parts, strict=True)), *batch.x.shape)
        for parts in zip(*found, strict=True)
    )
    measured, valid = np.asarray(batch.force), np.asarray(batch.valid)
    missing = (measured - friction) * valid
    widths = [smoothing_width(bandwidth, float(dt)) for dt in batch.dt]
    return ForceView(
        free=free,
        ahead=free + _earlier_mean(measured - free, horizon),
        missing=np.stack([_mean_over(row, width) for row, width in zip(missing, widths, strict=True)]),
        v=np.stack([_mean_over(row, batch.block // 2 * 2 + 1) for row in v]),
        bend=bend,
        e=missing / np.asarray(batch.noise)[:, None],
    )


def smoothing_width(bandwidth: float, dt: float) -> int:
    """Samples (an odd number) in the moving average that passes half the power at `bandwidth` Hz, `dt` s a sample."""
    return max(int(_HALF_POWER / (bandwidth * dt)) // 2 * 2 + 1, 1)


def _mean_over(values: Float[np.ndarray, " n"], width: int) -> Float[np.ndarray, " n"]:
    """Moving average over `width` (odd) samples, over fewer at the ends."""
    kernel = np.ones(width)
    return np.convolve(values, kernel, mode="same") / np.convolve(np.ones(values.size), kernel, mode="same")


def _earlier_mean(error: Float[np.ndarray, "r n"], horizon: int) -> Float[np.ndarray, "r n"]:
    """Mean of the `error`, shape `(r, n)`, over `horizon` samples that ended `horizon` samples before; 0 at
    the beginning."""
    total = np.pad(np.cumsum(error, axis=1), ((0, 0), (1, 0)))
    last = np.maximum(np.arange(error.shape[1]) - horizon + 1, 0)
    first = np.maximum(last - horizon, 0)
    return (total[:, last] - total[:, first]) / np.maximum(last - first, 1)
