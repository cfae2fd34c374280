"""Positions from a velocity that was measured alone."""

import numpy as np
from jaxtyping import Float

# The mean over the third of the intervals between six samples: exact for polynomials up to the fifth degree.
_MEAN = np.array([11.0, -93.0, 802.0, 802.0, -93.0, 11.0]) / 1440.0


def integral_of(v: Float[np.ndarray, " n"], sample_rate: float) -> Float[np.ndarray, " n"]:
    """The integral of a velocity `v` from the first sample on, shape `(n,)`; `sample_rate` in Hz.

    Each step is that of the polynomial through the six samples around it, of the trapezoidal rule at the ends. White
    noise of the velocity makes a random walk of nearly white steps of it, as the Kalman filter expects them
    (`simulation/kalman.py`). The trapezoidal rule alone takes more of the noise near half of the sample rate: it
    is taken for an unmeasured force, and parameters are found with far larger errors.
    """
    mean = 0.5 * (v[1:] + v[:-1])
    ends = _MEAN.size // 2 - 1
    mean[ends : mean.size - ends] = np.convolve(v, _MEAN, mode="valid")
    return np.concatenate([np.zeros(1), np.cumsum(mean)]) / sample_rate
