"""Series prepared for drawing: envelopes of long ones, the window of the close-up, and limits of axes."""

import numpy as np
from jaxtyping import Float

from frictionjax.diagnosis.recording_fit import RecordingFit
from frictionjax.diagnosis.verdict import Diagnosis

COLUMNS = 700  # of an envelope: about one for each pixel of a panel


def envelope(
    t: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], columns: int = COLUMNS
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Minimum and maximum of each of `columns` segments: a short line that draws like the long one.

    **Arguments:**

    - `t`: time, s, shape `(n,)`.
    - `y`: any unit, shape `(n,)`; a segment that is all NaN stays a gap.
    - `columns`: number of segments.

    **Returns:**

    `(t, y)` of shape `(m,)`; unchanged when the series is short enough already.
    """
    if y.size <= 4 * columns:
        return t, y
    length = -(-y.size // columns)
    whole = y.size // length
    parts = y[: whole * length].reshape(whole, length)
    low, high = np.fmin.reduce(parts, axis=1), np.fmax.reduce(parts, axis=1)
    # The order of minimum and maximum inside a segment does not show: it is one pixel wide.
    times = t[: whole * length : length]
    short_t = np.repeat(times, 2)
    short_y = np.stack([low, high], axis=1).ravel()
    rest = y[whole * length :]
    if rest.size:
        short_t = np.append(short_t, [t[whole * length]] * 2)
        short_y = np.append(short_y, [np.fmin.reduce(rest), np.fmax.reduce(rest)])
    return short_t, short_y


def zoom(recording: RecordingFit, share: float = 0.05, least: int = 100) -> slice:
    """The window in which the extended model improves most on the base model.

    It is the window with the largest mean drop of (residual force / its standard deviation)² from base to extended
    model; where it improves nowhere, the window with the largest residual of the base model.

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


def limits(*series: Float[np.ndarray, " _"], margin: float = 0.06) -> tuple[float, float]:
    """Limits of an axis that shows every finite value of `series`, with a margin.

    **Arguments:**

    - `series`: arrays in the unit of the axis.
    - `margin`: empty share at either end.
    """
    low = min((float(y[np.isfinite(y)].min()) for y in series if np.isfinite(y).any()), default=0.0)
    high = max((float(y[np.isfinite(y)].max()) for y in series if np.isfinite(y).any()), default=0.0)
    span = high - low or abs(high) or 1.0
    return low - margin * span, high + margin * span


def is_extended(diagnosis: Diagnosis) -> bool:
    """Whether there is an extended model whose predictions differ from those of the base model.

    **Arguments:**

    - `diagnosis`: an adequate one has no extended model, nor has an unknown one without a named effect.
    """
    if diagnosis.verdict == "adequate":
        return False
    return any(
        not np.array_equal(recording.predicted_base, recording.predicted_extended, equal_nan=True)
        for recording in diagnosis.recordings
    )


def holdout_first(recordings: tuple[RecordingFit, ...]) -> list[RecordingFit]:
    """The recordings in the order of the report: held-out ones first."""
    return sorted(recordings, key=lambda recording: recording.role != "holdout")


def _window_means(y: Float[np.ndarray, " n"], length: int) -> Float[np.ndarray, " m"]:
    total = np.concatenate([[0.0], np.cumsum(y)])
    return (total[length:] - total[:-length]) / length
