"""Velocity and acceleration from measured positions, by filters without phase that the recordings choose."""

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Float

_ORDER = 4  # of the Butterworth filter, which runs forwards and backwards
_TRIED = 60  # cut-offs
_NEAR = 1.2  # ratio of frequencies that count as neighbours
_ALIKE = 3.0  # neighbouring frequencies that the window makes alike
_CLEAR = 6.0  # standard deviations by which motion stands out: with three, noise does in one log of ten
_FLOOR = 0.75  # of the frequencies: above it a position has noise alone
WIDER = 3.0
"""Times the cut-off of an acceleration: there positions, and friction next to a reversal, lose little."""
_HIGHEST = 0.4  # of the sample rate: a filter there does nothing
_SETTLED = 1.0  # periods of the cut-off at both ends, in which a filter has not settled
_FEWEST = (
    20  # periods of the cut-off in a log: more than that is not lost at either end, even of a joint at rest
)


class JointMotion(eqx.Module):
    """The motion of all joints.

    **Attributes:**

    - `q`, `qd`, `qdd`: position, velocity and acceleration, shape `(n, j)`.
    - `x`: position through a filter `WIDER` times as wide, shape `(n, j)`: that of accelerations is too narrow for it.
    - `cuts`: the cut-off of each joint's filter, Hz, shape `(j,)`.
    - `edge`: samples at either end in which filters have not settled.
    """

    q: Float[np.ndarray, "n j"]
    qd: Float[np.ndarray, "n j"]
    qdd: Float[np.ndarray, "n j"]
    x: Float[np.ndarray, "n j"]
    cuts: Float[np.ndarray, " j"]
    edge: int = eqx.field(static=True)


def cut_off(x: Float[np.ndarray, " n"], sample_rate: float) -> float:
    """The cut-off, Hz, with which the filtered acceleration of a position `x` errs least.

    A filter with the response H loses 1 - H of the motion and keeps H of the noise. With the spectrum S and its white
    noise N, read off its upper end, the acceleration errs by the sum of ((S - N) (1 - H)^2 + N H^2) f^4 over them.
    Motion is where S stands out of N significantly, in the mean over neighbouring frequencies.

    **Arguments:**

    - `x`: measured position, shape `(n,)`.
    - `sample_rate`: Hz.
    """
    # The side lobes of this window fall so fast that a motion that ends elsewhere than it began stays where it is.
    window = scipy.signal.windows.hann(x.size, sym=False) ** 3
    frequency, power = scipy.signal.periodogram(x, sample_rate, window=window, detrend="constant")
    noise = float(np.mean(power[frequency > _FLOOR * frequency[-1]]))
    highest = _HIGHEST * sample_rate
    tried = np.geomspace(min(_FEWEST * sample_rate / x.size, highest), highest, _TRIED)
    kept = 1.0 / (1.0 + (frequency / tried[:, None]) ** (2 * _ORDER))
    places = np.arange(frequency.size)
    low, high = (places / _NEAR).astype(int), np.minimum(np.ceil(places * _NEAR).astype(int) + 1, places.size)
    total = np.concatenate([[0.0], np.cumsum(power)])
    mean = (total[high] - total[low]) / (high - low)
    scatter = noise * np.sqrt(_ALIKE / (high - low))
    motion = np.where(mean > noise + _CLEAR * scatter, np.maximum(power - noise, 0.0), 0.0)
    cost = (motion * (1.0 - kept) ** 2 + noise * kept**2) @ frequency**4
    return float(tried[int(np.argmin(cost))])


def wider(cut: float, sample_rate: float) -> float:
    """`WIDER` times the frequency `cut`, Hz, as far as the `sample_rate` goes."""
    return min(WIDER * cut, _HIGHEST * sample_rate)


def smoothed(values: Float[np.ndarray, "..."], sample_rate: float, cut: float) -> Float[np.ndarray, "..."]:
    """The `values` along their first axis without what is above the frequency `cut`, Hz, and without a lag."""
    sections = scipy.signal.butter(_ORDER, cut, fs=sample_rate, output="sos")
    reach = min(round(3.0 * sample_rate / cut), values.shape[0] - 1)
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0, padlen=reach))


def smooth_motion(
    q: Float[np.ndarray, "n j"], sample_rate: float, cuts: Float[np.ndarray, " j"]
) -> JointMotion:
    """The motion behind measured positions.

    **Arguments:**

    - `q`: positions, shape `(n, j)`.
    - `sample_rate`: Hz.
    - `cuts`: the cut-off of each joint, Hz, shape `(j,)`.
    """
    t = np.arange(q.shape[0]) / sample_rate
    pairs = list(zip(q.T, cuts, strict=True))
    filtered = np.stack([smoothed(x, sample_rate, float(cut)) for x, cut in pairs], axis=1)
    wide = np.stack([smoothed(x, sample_rate, wider(float(cut), sample_rate)) for x, cut in pairs], axis=1)
    curve = scipy.interpolate.CubicSpline(t, filtered)
    edge = int(np.ceil(_SETTLED * sample_rate / float(np.min(cuts))))
    return JointMotion(filtered, np.asarray(curve(t, 1)), np.asarray(curve(t, 2)), wide, cuts, edge)
