"""Where the diagnosis of imposed motions differs: effects are simulated as they are, and the answer is a force.

The motion is the same whatever the model, so that an effect needs no signals along an observed motion: the model with
it is run. Nothing drifts, so that a free run is the prediction; and what drives, moves and measures the position takes
no part.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from frictionjax.diagnosis.evidence.judgement import Judgement
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.simulation.imposed import run_imposed

_HALF_POWER = 0.443  # of a moving average: its width times the frequency at which it passes half the power


class ForceView(eqx.Module):
    """One model's view of imposed motions, shape `(r, n)`: the force of a `free` run from the first measured force, and
    `ahead` by 0.1 s; the force that it lacks, `missing` (smoothed); `v` (its mean over a block), `bend` (|z| over
    Fs/sigma0) and the standardised errors `e`."""

    free: np.ndarray
    ahead: np.ndarray
    missing: np.ndarray
    v: np.ndarray
    bend: np.ndarray
    e: np.ndarray


@eqx.filter_jit
def _runs(drive, batch: ImposedBatch, deflection):
    sigma0, most = drive.friction.sigma0, drive.friction.Fs / drive.friction.sigma0

    def first_deflection(x, force, dt, earlier):
        # The bristles take what the other forces leave of the first sample's.
        others = run_imposed(drive, x[:2], dt, 0.0, earlier=earlier)[2][0]
        return jnp.clip((force[0] - others) / sigma0, -most, most)

    first = jax.vmap(first_deflection)(batch.x, batch.force, batch.dt, batch.before)
    v, z, friction = batch.run(drive, deflection * most)
    return batch.run(drive, first)[2], friction, v, jnp.abs(z[..., 0]) / most


def view_of_forces(judgement: Judgement, batch: ImposedBatch, horizon: int, bandwidth: float) -> ForceView:
    """See the recordings of `batch` through the model of the `judgement`.

    `ahead` is the model's force and the mean error of it until the `horizon` (samples) began, over as many samples.

    **Arguments:** `horizon`: samples; `bandwidth`: of the missing force, Hz.
    """
    parts = _runs(judgement.drive, batch, jnp.asarray(judgement.deflection))
    free, friction, v, bend = (np.asarray(part) for part in parts)
    measured, valid = np.asarray(batch.force), np.asarray(batch.valid)
    lacking = (measured - friction) * valid
    widths = [smoothing_width(bandwidth, float(dt)) for dt in batch.dt]
    return ForceView(
        free=free,
        ahead=free + _until(measured - free, horizon),
        missing=np.stack([_mean_over(row, width) for row, width in zip(lacking, widths, strict=True)]),
        v=np.stack([_mean_over(row, batch.block // 2 * 2 + 1) for row in v]),
        bend=bend,
        e=lacking / np.asarray(batch.noise)[:, None],
    )


def smoothing_width(bandwidth: float, dt: float) -> int:
    """Samples (an odd number) in the moving average that passes half the power at `bandwidth` Hz, `dt` s a sample."""
    return max(int(_HALF_POWER / (bandwidth * dt)) // 2 * 2 + 1, 1)


def _mean_over(values: np.ndarray, width: int) -> np.ndarray:
    """Moving average over `width` (odd) samples, over fewer at the ends."""
    kernel = np.ones(width)
    return np.convolve(values, kernel, mode="same") / np.convolve(np.ones(values.size), kernel, mode="same")


def _until(error: np.ndarray, horizon: int) -> np.ndarray:
    """Mean of the `error`, shape `(r, n)`, over `horizon` samples that ended `horizon` samples before; 0 at first."""
    total = np.pad(np.cumsum(error, axis=1), ((0, 0), (1, 0)))
    last = np.maximum(np.arange(error.shape[1]) - horizon + 1, 0)
    first = np.maximum(last - horizon, 0)
    return (total[:, last] - total[:, first]) / np.maximum(last - first, 1)
