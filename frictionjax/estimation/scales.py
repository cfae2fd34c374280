"""The plant's own sizes, in which strengths of effects are measured and nuisances are tried."""

import numpy as np

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.evidence import Forces
from frictionjax.physics import Drive


def plant_scales(drive: Drive, batch: Batch | Forces) -> dict[str, float]:
    """Sizes by the names that `Parameter.scale` may use.

    **Arguments:**

    - `drive`: the fitted base model.
    - `batch`: the recordings.
    """
    friction = drive.friction
    positions = np.asarray(batch.x)
    inside = [positions[row, : batch.lengths[row]] for row in range(len(batch.lengths))]
    low, high = min(x.min() for x in inside), max(x.max() for x in inside)
    Fc, stroke = float(friction.Fc), float(high - low)
    return {
        "Fc": Fc,
        "sigma0": float(friction.sigma0),
        "sigma2": float(friction.sigma2),
        "vs": float(friction.vs),
        "zs": float(friction.Fs / friction.sigma0),
        "stroke": stroke,
        "center": float(0.5 * (low + high)),
        "Fc/stroke": Fc / stroke,
        "dt": float(np.min(np.asarray(batch.dt))),
    }
