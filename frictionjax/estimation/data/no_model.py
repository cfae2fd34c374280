"""What the observer would err without a model: the measure of what any model has to explain."""

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from frictionjax.estimation.data.batch import Batch
from frictionjax.simulation import Gains, innovation_gain


def innovations_without_model(batch: Batch, gains: Gains) -> Float[np.ndarray, "r n"]:
    """Standardised innovations of an observer that expects every machine to keep its speed, shape `(r, n)`: 0 where
    not scored.

    With a double pole p it leaves (1 - q)^2 / (1 - p q)^2 of the position, q being the unit delay: the acceleration
    over the observer's memory.

    **Arguments:**

    - `batch`: the recordings.
    - `gains`: of the observer, one of each for a recording.
    """
    poles = np.sqrt(1.0 - np.asarray(gains.position))
    unit = np.asarray(batch.noise * innovation_gain(gains))
    x, steps = np.asarray(batch.x), np.arange(batch.x.shape[1])
    travel = np.asarray(batch.x0)[:, None] + (np.asarray(batch.v0) * np.asarray(batch.dt))[:, None] * steps
    left = [
        lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole, pole**2], own)
        for pole, own in zip(poles, x - travel, strict=True)
    ]
    return np.stack(left) / unit[:, None] * np.asarray(batch.valid)
