"""Time stamps: the sample rate they mean, their jitter and gaps, and the uniform grid when they need one."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from frictionjax.core import InputError
from frictionjax.recordings.readers import AbstractTable
from frictionjax.recordings.recording import Sampling
from frictionjax.recordings.words import shown

# A step that deviates by more than this part of itself is jitter; it is what the simulation may neglect.
JITTER_TOLERANCE = 1e-3
# A step longer than this many nominal ones is a gap.
_GAP = 1.5
# Filling more than this part of a recording would be invention.
_MOST_MISSING = 0.2
# A rate this near (relatively) to a whole number of Hz or of microseconds is that number.
_SNAP = 1e-5


class Grid(eqx.Module):
    """Uniform time for a recording.

    **Attributes:**

    - `sample_rate`: Hz.
    - `sampling`: what the time stamps were like.
    - `stamps`: the file's time stamps, s, shape `(m,)`.
    - `uniform`: the times to resample at, s, shape `(n,)`; None when the stamps are uniform as they are.
    """

    sample_rate: float = eqx.field(static=True)
    sampling: Sampling
    stamps: Float[np.ndarray, " m"]
    uniform: Float[np.ndarray, " n"] | None

    def follow(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """A measured channel on the grid, by linear interpolation between its samples."""
        return values if self.uniform is None else np.interp(self.uniform, self.stamps, values)

    def hold(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """An applied input on the grid: the value held in the middle of each grid interval.

        Each sample is held until the next stamp. Reading that at the grid's own times would, with the slightest
        jitter, take the value before the right one every second time.
        """
        if self.uniform is None:
            return values
        middle = self.uniform + 0.5 / self.sample_rate
        return values[np.maximum(np.searchsorted(self.stamps, middle, side="right") - 1, 0)]


def find_grid(stamps: Float[np.ndarray, " m"], table: AbstractTable, column: str, first: int = 0) -> Grid:
    """The uniform grid that time stamps mean.

    Stamps rounded to too few decimals (0.0003, 0.0007, 0.0010 at 3 kHz) are not jitter; steps that deviate by
    more than `JITTER_TOLERANCE` otherwise are.

    **Arguments:**

    - `stamps`: finite times, s, shape `(m,)`, `m >= 2`.
    - `table`, `column`, `first`: where they come from, for messages; `first` is the position of the first.

    **Returns:** the `Grid`.

    **Raises:** `InputError` when time stands still or goes backwards, or too much of it is missing.
    """
    file = shown(table.path, 200)
    steps = np.diff(stamps)
    wrong = np.flatnonzero(steps <= 0)
    if wrong.size:
        k = int(wrong[0])
        verb = "stands still" if steps[k] == 0 else "goes backwards"
        raise InputError(
            f"time {verb} ({stamps[k]:.9g} s, then {stamps[k + 1]:.9g} s)",
            file=file,
            place=f"{table.place(first + k + 1)}, column `{shown(column)}`",
            cure="Correct the time stamps (more decimals, if they were rounded), or, when the samples are known "
            "to be evenly spaced, remove the column and give sample_rate",
        )
    step = float(np.median(steps))
    count = np.maximum(np.rint(steps / step), 1.0)
    missing = float(count.sum()) - steps.size
    if missing > _MOST_MISSING * stamps.size:
        raise InputError(
            f"time steps range from {steps.min():.4g} s to {steps.max():.4g} s: this is not a uniformly sampled "
            "recording",
            file=file,
            place=f"column `{shown(column)}`",
            cure="Log at a fixed rate, or use the part without interruptions (interval)",
        )
    index = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    step, start = _line(index, stamps)
    gaps = np.flatnonzero(steps > _GAP * step)
    deviation = float(np.abs(steps / step - count).max())
    jitter = 0.0 if _only_rounded(stamps, index, step, start, deviation) else deviation
    rate = _snapped(1.0 / step)
    resample = jitter > JITTER_TOLERANCE or bool(gaps.size)
    sampling = Sampling(
        jitter=jitter,
        gaps=tuple((float(stamps[k]), float(steps[k])) for k in gaps),
        missing=int(missing),
        resampled=resample,
    )
    return Grid(rate, sampling, stamps, start + step * np.arange(index[-1] + 1) if resample else None)


def _line(index: Int[np.ndarray, " m"], stamps: Float[np.ndarray, " m"]) -> tuple[float, float]:
    """Least-squares step and start of `stamps = start + step * index`, s."""
    centred = index - index.mean()
    step = float(centred @ (stamps - stamps.mean()) / (centred @ centred))
    return step, float(stamps.mean() - step * index.mean())


def _only_rounded(
    stamps: Float[np.ndarray, " m"], index: Int[np.ndarray, " m"], step: float, start: float, deviation: float
) -> bool:
    """Whether the stamps deviate from the grid by no more than their floating-point or decimal rounding."""
    floating = 2 * float(np.spacing(np.abs(stamps).max()))
    if deviation * step <= 2 * floating:
        return True
    if deviation <= JITTER_TOLERANCE:
        return False
    error = float(np.abs(stamps - (start + step * index)).max())
    for decimals in range(10):
        unit = 10.0**-decimals
        if np.abs(stamps - np.rint(stamps / unit) * unit).max() <= max(1e-6 * unit, floating):
            # A step that is a whole number of units needs no rounding: then the deviation is real.
            whole = abs(step / unit - round(step / unit)) < 0.01
            return not whole and error <= 0.55 * unit + floating
    return False


def _snapped(rate: float) -> float:
    """The rate that was meant: a whole number of Hz, or a step of whole microseconds, when very near."""
    microseconds = round(1e6 / rate)
    for nominal in (float(round(rate)), 1e6 / microseconds if microseconds else rate):
        if abs(nominal - rate) <= _SNAP * rate:
            return nominal
    return rate
