"""Time stamps: their sample rate, jitter and gaps, and the uniform grid to resample to."""

from collections.abc import Iterator

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from frictionjax.core import InputError
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.recording import JITTER_TOLERANCE, Sampling
from frictionjax.recordings.words import shown

# A step longer than this many nominal ones is a gap.
_GAP = 1.5
# A clock that is behind by no more than this part of a step has caught up.
_CAUGHT_UP = 0.05
# No more than this part of a recording is filled by interpolation.
_MOST_MISSING = 0.2
_STILL = 1e-6  # of the usual step: samples that are closer have one time stamp
_ENDLESS = (
    1e9  # samples that a step may lack: more are refused in any case, and are no whole number of this machine
)
# A rate this near (relatively) to a whole number of Hz or of microseconds is that number.
_SNAP = 1e-5


class TimeGrid(eqx.Module):
    """Uniform time for a recording.

    **Attributes:**

    - `sample_rate`: Hz.
    - `sampling`: how far the time stamps were from uniform.
    - `stamps`: the file's time stamps, s, shape `(m,)`, without their rounding error where that was the only deviation.
    - `uniform`: the times to resample at, s, shape `(n,)`; None when the stamps are uniform as they are.
    """

    sample_rate: float = eqx.field(static=True)
    sampling: Sampling
    stamps: Float[np.ndarray, " m"]
    uniform: Float[np.ndarray, " n"] | None

    def follow(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """A measured channel on the grid, by a cubic spline through its samples; over gaps, by straight lines.

        Straight lines everywhere would cut the corners of an accelerated motion by up to a dt^2 / 8, which at some kHz
        is more than the step of a good encoder.
        """
        if self.uniform is None:
            return values
        times = np.clip(self.uniform, self.stamps[0], self.stamps[-1])
        before = np.clip(np.searchsorted(self.stamps, times, side="right"), 1, self.stamps.size - 1) - 1
        filled = np.diff(self.stamps)[before] > _GAP / self.sample_rate
        return np.where(
            filled,
            np.interp(times, self.stamps, values),
            scipy.interpolate.CubicSpline(self.stamps, values)(times),
        )

    def hold(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """An applied input on the grid: its mean over each grid interval, each sample held until the next stamp.

        The mean keeps the momentum that the input gave. Reading the input at the grid's own times would, with the
        slightest jitter, take the value before the right one every second time.
        """
        if self.uniform is None:
            return values
        given = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(self.stamps))])
        edges = np.append(self.uniform, 2.0 * self.uniform[-1] - self.uniform[-2])
        until = np.interp(edges, self.stamps, given)
        until += values[0] * np.minimum(edges - self.stamps[0], 0.0)
        until += values[-1] * np.maximum(edges - self.stamps[-1], 0.0)
        return np.diff(until) / np.diff(edges)


def find_grid(
    stamps: Float[np.ndarray, " m"],
    table: AbstractColumnTable,
    column: str,
    rows: Int[np.ndarray, " m"] | None = None,
) -> TimeGrid:
    """The uniform grid behind time stamps.

    Stamps rounded to too few decimals (0.0003, 0.0007, 0.0010 at 3 kHz) are not jitter; steps that deviate by
    more than `JITTER_TOLERANCE` otherwise are.

    **Arguments:**

    - `stamps`: finite times, s, shape `(m,)`, `m >= 2`.
    - `table`, `column`, `rows`: where they come from, for messages; `rows` are their positions in the column, shape
        `(m,)`; None: from the first on.

    **Returns:** the `TimeGrid`.

    **Raises:** `InputError` when time stands still or goes backwards, or too much of it is missing.
    """
    file = shown(table.path, 200)
    steps = np.diff(stamps)
    # Between two samples a millionth of the usual step apart any curve would be vertical.
    wrong = np.flatnonzero(steps <= max(_STILL * float(np.median(steps)), 0.0))
    if wrong.size:
        k = int(wrong[0])
        verb = "goes backwards" if steps[k] < 0 else "stands still"
        raise InputError(
            f"time {verb} ({stamps[k]:.15g} s, then {stamps[k + 1]:.15g} s)",
            file=file,
            place=f"{table.place(int(rows[k + 1]) if rows is not None else k + 1)}, column `{shown(column)}`",
            cure="Correct the time stamps (more decimals, if they were rounded), or, when the samples are known "
            "to be evenly spaced, remove the column and give sample_rate",
        )
    typical = float(np.median(steps))
    interrupted = InputError(
        f"time steps range from {steps.min():.4g} s to {steps.max():.4g} s: this is not a uniformly sampled recording",
        file=file,
        place=f"column `{shown(column)}`",
        cure="Log at a fixed rate, or use the part without interruptions (interval)",
    )
    if float(steps.max()) > _ENDLESS * typical:
        raise interrupted
    index = np.arange(stamps.size)
    step, start = _line(index, stamps)
    if float(np.abs(stamps - (start + step * index)).max()) <= _rounding(stamps, step):
        return TimeGrid(_snapped(1.0 / step), Sampling(), stamps, None)
    count = _counted(steps / typical)
    missing = float(count.sum()) - steps.size
    if max(missing, np.count_nonzero(steps > _GAP * typical)) > _MOST_MISSING * stamps.size:
        raise interrupted
    index = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    step, start = _line(index, stamps)
    gaps = np.flatnonzero(steps > _GAP * step)
    jitter, ideal = float(np.abs(steps / step - count).max()), start + step * index
    if float(np.abs(stamps - ideal).max()) <= _rounding(stamps, step):
        jitter, stamps = 0.0, ideal
    resample = jitter > JITTER_TOLERANCE or bool(gaps.size)
    sampling = Sampling(
        jitter=jitter,
        gaps=tuple((float(stamps[k]), float(steps[k])) for k in gaps),
        missing=int(missing),
        resampled=resample,
    )
    uniform = start + step * np.arange(index[-1] + 1) if resample else None
    return TimeGrid(_snapped(1.0 / step), sampling, stamps, uniform)


def punctual(stamps: Float[np.ndarray, " m"]) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """The `stamps`, s, shape `(m,)`, with those that came late put back between their neighbours, and which these were.

    A clock that stalls and catches up (one long step, then short ones that make up for it) has late stamps and no gap:
    these samples were taken in time.
    """
    steps = np.diff(stamps)
    late = np.zeros(stamps.size, dtype=bool)
    typical = float(np.median(steps)) if steps.size else 1.0
    if np.count_nonzero(steps > _GAP * typical) > _MOST_MISSING * steps.size:
        return stamps, late  # no clock that is late now and then
    if typical > 0.0:
        for first, end, lacking in _stalls(steps / typical):
            if not lacking:
                late[first + 1 : end] = True
    index = np.arange(stamps.size)
    return np.where(late, np.interp(index, index[~late], stamps[~late]), stamps), late


def _counted(steps: Float[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
    """How many samples after the one before each sample was taken, from `steps` in units of the typical one: a long
    step is a gap but for what the steps after it are too short."""
    count = np.ones(steps.size, dtype=np.int64)
    for first, end, lacking in _stalls(steps):
        count[first + int(np.argmax(steps[first:end]))] += lacking
    return count


def _stalls(steps: Float[np.ndarray, " k"]) -> Iterator[tuple[int, int, int]]:
    """Where the clock stalls: its first long step, the step after the last one in which it is behind, and how many
    samples it never makes up for; `steps` are in units of the typical one."""
    end = 0
    for first in np.flatnonzero(steps > _GAP):
        if first < end:
            continue
        behind, end = 0.0, int(first)
        # Behind for as long as the clock stalls or catches up; a usual step ends it.
        while end < steps.size and (steps[end] > _GAP or (steps[end] < 1.0 and behind >= _CAUGHT_UP)):
            behind += steps[end] - 1.0
            end += 1
        yield int(first), end, max(round(min(behind, _ENDLESS)), 0)


def _line(index: Int[np.ndarray, " m"], stamps: Float[np.ndarray, " m"]) -> tuple[float, float]:
    """Least-squares step and start of `stamps = start + step * index`, s."""
    centred = index - index.mean()
    step = float(centred @ (stamps - stamps.mean()) / (centred @ centred))
    return step, float(stamps.mean() - step * index.mean())


def _rounding(stamps: Float[np.ndarray, " m"], step: float) -> float:
    """How far the stamps of a uniform grid may lie from it, s, by their floating-point or decimal rounding."""
    largest = np.abs(stamps).max()
    single = largest < np.finfo(np.float32).max and np.array_equal(stamps, stamps.astype(np.float32))
    floating = 2 * float(np.spacing(np.float32(largest) if single else largest))
    for decimals in range(10):
        unit = 10.0**-decimals
        if np.abs(stamps - np.rint(stamps / unit) * unit).max() <= max(1e-6 * unit, floating):
            # Steps of a whole number of units need no rounding: what deviates from them deviates in truth.
            whole = abs(step / unit - round(step / unit)) < 1e-3
            return floating if whole else 0.55 * unit + floating
    return floating


def _snapped(rate: float) -> float:
    """The nominal rate: the nearest whole number of Hz, or step of whole microseconds, when very near."""
    microseconds = round(1e6 / rate)
    for nominal in (float(round(rate)), 1e6 / microseconds if microseconds else rate):
        if abs(nominal - rate) <= _SNAP * rate:
            return nominal
    return rate
