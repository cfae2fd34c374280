"""The robust misfit: the Cauchy cost with its scale at the noise, per sample, above that of errors at the noise."""

import numpy as np
from jaxtyping import Float, Shaped

from frictionjax.estimation.data.batch import AbstractBatch


def block_misfits(
    power: Float[np.ndarray, "*b"],
    count: float | Float[np.ndarray, "..."],
    floor: float | Float[np.ndarray, "..."] = 1.0,
) -> Float[np.ndarray, "*b"]:
    """Half of the logarithm of (`power` + `floor`) / (2 `floor`), times the `count` of samples in each block: 0 at the
    floor, half the logarithm of the power far above it. The one place that has this formula."""
    return 0.5 * count * np.log((power + floor) / (2.0 * floor))


def losses_of(
    power: Float[np.ndarray, "r b"], batch: AbstractBatch, floor: float | Float[np.ndarray, "..."] = 1.0
) -> Float[np.ndarray, "r b"]:
    """Misfit of each block of the recordings against the power `floor`, shape `(r, b)`; large where not finite."""
    power = np.nan_to_num(np.asarray(power), nan=1e30, posinf=1e30)
    return block_misfits(power, np.asarray(batch.block_count), floor)


def misfit_of(
    power: Float[np.ndarray, "r b"], rows: Shaped[np.ndarray, " r"], batch: AbstractBatch, scale: float = 1.0
) -> float:
    """Robust misfit per sample of the recordings `rows` (weights, shape `(r,)`) with the Cauchy loss of the squared
    `scale`; infinite where a trajectory is not finite."""
    if not np.all(np.isfinite(power)):
        return float("inf")
    samples = float(np.sum(np.asarray(batch.block_count) * rows[:, None]))
    return float(np.sum(losses_of(power, batch, scale) * rows[:, None])) / max(samples, 1.0)
