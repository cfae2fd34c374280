"""The identification of robotics' textbooks: derivatives of the measured position, then linear least squares.

Of a mass with Coulomb and viscous friction, `motor_constant` u = J a + Fc sgn v + sigma2 v + offset. In closed loop the
noise of the encoder is in both sides, and the estimate is biased; instruments that are free of the noise remove the
bias.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import butter, sosfiltfilt

Recording = tuple[np.ndarray, np.ndarray, float]
"""Input u (n,) in input units, held between samples; position x (n,) in position units; sample time dt in s."""


class Estimate(NamedTuple):
    """One number each: `J` in force units s^2 per position unit, `Fc` and `offset` in force units, `sigma2` in force
    units s per position unit."""

    J: float
    Fc: float
    sigma2: float
    offset: float


def low_pass(signal: np.ndarray, dt: float, cutoff: float | None) -> np.ndarray:
    """`signal`, shape (n,), without what is above `cutoff` Hz: a Butterworth filter of order 4, forwards and backwards,
    so that nothing is delayed; `signal` itself if that is None. `dt`: s."""
    if cutoff is None:
        return signal
    sections = np.asarray(butter(4, cutoff, fs=1.0 / dt, output="sos"))
    return sosfiltfilt(sections, signal, padlen=min(_settling(dt, cutoff), signal.size - 1))


def _settling(dt: float, cutoff: float | None) -> int:
    """Samples after which the end of a record is forgotten by the low-pass: two periods of its cutoff."""
    return 0 if cutoff is None else round(2.0 / (cutoff * dt))


def derivatives(x: np.ndarray, dt: float, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration, shape (n - 2 `every`,) each, of the positions `x` (n,): central differences over
    `every` samples of `dt` s to both sides."""
    before, here, after = x[: -2 * every], x[every:-every], x[2 * every :]
    return (after - before) / (2.0 * every * dt), (after - 2.0 * here + before) / (every * dt) ** 2


def between(u: np.ndarray, every: int) -> np.ndarray:
    """The held input `u` (n,) as it enters the second difference, shape (n - 2 `every`,): J times the acceleration of
    `derivatives` is exactly this for a free mass. For `every` = 1 it is the mean of the holds on both sides."""
    rising = (np.arange(every) + 0.5) / every**2
    return np.convolve(u[:-1], np.concatenate([rising, rising[::-1]]), mode="valid")


def inverse_dynamics(
    recordings: Sequence[Recording],
    motor_constant: float,
    cutoff: float | None,
    threshold: float,
    *,
    every: int = 1,
    instruments: Sequence[np.ndarray] | None = None,
) -> tuple[Estimate, Estimate]:
    """Least squares of the force on [a, sgn v, v, 1]: values and classical standard errors, s^2 (W'W)^-1 with W the
    regressors and s^2 the variance of what is left.

    `motor_constant`: force per input unit; `cutoff`: Hz, of the low-pass through which both sides go, its two periods
    left out at both ends of a record, or None for no filter; `threshold`: rows count where |v| is above it, position
    units per s; `every`: spacing of the differences and of the rows that are kept, in samples.
    `instruments`: positions without noise, one (n,) for each recording (simulated, or the reference). With Z their
    [a, sgn v, v, 1], taken in the same way, the estimate is (Z'W)^-1 Z'y; they then decide which rows count.
    """
    lefts, rights, sides = [], [], []
    for i, (u, x, dt) in enumerate(recordings):
        columns = _columns(x, dt, cutoff, every)
        through = columns if instruments is None else _columns(instruments[i], dt, cutoff, every)
        kept = np.arange(_settling(dt, cutoff), len(columns) - _settling(dt, cutoff), every)
        kept = kept[np.abs(through[kept, 2]) > threshold]
        lefts.append(motor_constant * low_pass(between(u, every), dt, cutoff)[kept])
        rights.append(columns[kept])
        sides.append(through[kept])
    y, W, Z = np.concatenate(lefts), np.concatenate(rights), np.concatenate(sides)
    if y.size <= W.shape[1]:
        raise ValueError(f"only {y.size} rows have |v| above {threshold}: lower `threshold`")
    solve = np.linalg.inv(Z.T @ W)
    values = solve @ (Z.T @ y)
    left = y - W @ values
    covariance = left @ left / (y.size - values.size) * solve @ (Z.T @ Z) @ solve.T
    return Estimate(*values.tolist()), Estimate(*np.sqrt(np.diag(covariance)).tolist())


def _columns(x: np.ndarray, dt: float, cutoff: float | None, every: int) -> np.ndarray:
    """[a, sgn v, v, 1], shape (n - 2 `every`, 4), of the positions `x`, shape (n,), each through the same low-pass."""
    v, a = derivatives(low_pass(x, dt, cutoff), dt, every)
    return np.stack([a, low_pass(np.sign(v), dt, cutoff), v, np.ones_like(v)], axis=1)
