"""Long series made short enough to draw: envelopes, the window worth a closer look, and limits for an axis."""

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.verdict import Diagnosis, RecordingFit

COLUMNS = 700  # of an envelope: about one for each pixel of a panel


def envelope(
    t: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], columns: int = COLUMNS
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """The least and the greatest value in each of `columns` stretches: a short line that looks like the long one.

    **Arguments:**

    - `t`: time, s, shape `(n,)`.
    - `y`: any unit, shape `(n,)`; NaN stays a gap where a whole stretch is NaN.
    - `columns`: number of stretches.

    **Returns:**

    `(t, y)` of shape `(m,)`; unchanged when the series is short enough already.
    """
    if y.size <= 4 * columns:
        return t, y
    length = -(-y.size // columns)
    whole = y.size // length
    parts = y[: whole * length].reshape(whole, length)
    low, high = np.fmin.reduce(parts, axis=1), np.fmax.reduce(parts, axis=1)
    # Least and greatest in the order in which they happened is of no matter at one pixel's width.
    times = t[: whole * length : length]
    short_t = np.repeat(times, 2)
    short_y = np.stack([low, high], axis=1).ravel()
    rest = y[whole * length :]
    if rest.size:
        short_t = np.append(short_t, [t[whole * length]] * 2)
        short_y = np.append(short_y, [np.fmin.reduce(rest), np.fmax.reduce(rest)])
    return short_t, short_y


def zoom(recording: RecordingFit, share: float = 0.05, least: int = 100) -> slice:
    """The stretch where the base model misses most of what the extended model has.

    It is the window with the largest mean drop of (residual force / its standard deviation)² from base to extended
    model; where the extended model improves on nothing, the window with the largest base residual.

    **Arguments:**

    - `recording`: arrays of shape `(n,)`.
    - `share`: length of the window as a share of the recording.
    - `least`: least length, samples.

    **Returns:**

    A slice of samples, never longer than the recording.
    """
    n = recording.t.size
    length = min(max(int(share * n), least), n)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        base = np.square(recording.residual_force / recording.residual_force_std)
        extended = np.square(recording.residual_force_extended / recording.residual_force_std)
    base, extended = (np.nan_to_num(power, nan=0.0, posinf=0.0) for power in (base, extended))
    drop = _window_means(base - extended, length)
    if drop.max() <= 0:
        drop = _window_means(base, length)
    start = int(np.argmax(drop))
    return slice(start, start + length)


def limits(*series: Float[np.ndarray, " n"], margin: float = 0.06) -> tuple[float, float]:
    """Limits of an axis that holds every finite value of `series`, with a margin.

    **Arguments:**

    - `series`: arrays in the unit of the axis.
    - `margin`: empty share at either end.
    """
    low = min((float(y[np.isfinite(y)].min()) for y in series if np.isfinite(y).any()), default=0.0)
    high = max((float(y[np.isfinite(y)].max()) for y in series if np.isfinite(y).any()), default=0.0)
    span = high - low or abs(high) or 1.0
    return low - margin * span, high + margin * span


def is_extended(diagnosis: Diagnosis) -> bool:
    """Whether there is an extended model, one that predicts anything other than the base model does.

    **Arguments:**

    - `diagnosis`: an adequate one has no extended model, nor has an unknown one that nothing could be added to.
    """
    if diagnosis.verdict == "adequate":
        return False
    return any(
        not np.array_equal(recording.predicted_base, recording.predicted_extended, equal_nan=True)
        for recording in diagnosis.recordings
    )


def holdout_first(recordings: tuple[RecordingFit, ...]) -> list[RecordingFit]:
    """The recordings in the order of the report: those kept aside come first."""
    return sorted(recordings, key=lambda recording: recording.role != "holdout")


def _window_means(y: Float[np.ndarray, " n"], length: int) -> Float[np.ndarray, " m"]:
    total = np.concatenate([[0.0], np.cumsum(y)])
    return (total[length:] - total[:-length]) / length
