"""Time as files have it: counted from 1970 in parts of a second, or with a clock of its own for each channel."""

import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.words import shown

_SINCE_1970 = (946_684_800.0, 4_102_444_800.0)
"""The first seconds of the years 2000 and 2100, s since 1970."""
_PARTS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SLOWEST_EPOCH = 2.0
"""Longest step of a clock that counts from 1970, s: a machine's uptime in a smaller part of a second, which may have
the same size, would then step by hours."""


FASTEST_LOG = 1e5
"""Hz; a header whose unit of time would make a log faster than this is not believed where the stamps in s are usual."""
_USUAL = (20.0, FASTEST_LOG)
"""Sample rates of servo logs, Hz."""
SLOWEST_LOG = 5.0
"""Hz; stamps without a unit that would make a log slower than this are not taken for s: a move that lasts a second
would have five samples."""
_FEWEST = 100
"""Samples; a shorter recording is refused whatever its clock."""
_SAME_RATE = 1e-3
"""Part by which a given sample rate and that of the stamps may differ."""


def contradicts(stamps: Float[np.ndarray, " n"], factor: float) -> bool:
    """Whether time stamps cannot be in the unit that their header says: in it the log would be faster than any, and
    in s it has a usual rate.

    **Arguments:**

    - `stamps`: as the file has them, shape `(n,)`.
    - `factor`: from the header's unit to s.

    **Returns:** True where the header is not to be believed.
    """
    step = float(np.median(np.diff(stamps))) if stamps.size > 1 else 0.0
    return step > 0.0 and 1.0 / (step * factor) > FASTEST_LOG and _USUAL[0] <= 1.0 / step <= _USUAL[1]


def seconds(
    stamps: Float[np.ndarray, " n"], column: str, sample_rate: float | None = None, file: str | None = None
) -> tuple[Float[np.ndarray, " n"], str]:
    """Time stamps without a unit in s: counts since 1970 in ms, us or ns are recognised by their size, and parts of a
    second by a log that would be too slow in s.

    **Arguments:**

    - `stamps`: as the file has them, shape `(n,)`.
    - `column`: the column's name, for the sentence.
    - `sample_rate`: samples per second, where the case gives it.
    - `file`: for the message.

    **Returns:** the stamps, s, shape `(n,)`, and a sentence on how they were read, empty where they were in s.

    **Raises:** `InputError` for stamps that are too slow for s where more than one other reading is possible.
    """
    if stamps.size < 2 or not np.isfinite(stamps).all():
        return stamps, ""
    step = float(np.median(np.diff(stamps)))
    for unit, factor in _PARTS.items():
        low, high = (bound / factor for bound in _SINCE_1970)
        if low <= stamps[0] < high and 0.0 < step * factor <= _SLOWEST_EPOCH:
            return stamps * factor, f"`{shown(column)}` was read as {unit} since 1970"
    if stamps.size >= _FEWEST and step * SLOWEST_LOG > 1.0 + _SAME_RATE:
        return _parts_of_a_second(stamps, step, shown(column), sample_rate, file)
    return stamps, ""


def _parts_of_a_second(
    stamps: Float[np.ndarray, " n"], step: float, column: str, sample_rate: float | None, file: str | None
) -> tuple[Float[np.ndarray, " n"], str]:
    """Stamps too slow for s, `step` apart, in s; and how they were read."""
    counts = bool(np.all(np.diff(stamps) == 1.0))
    if sample_rate is not None:
        if counts:
            return stamps / sample_rate, f"`{column}` counts samples: it was divided by the sample rate"
        for unit, factor in _PARTS.items():
            if abs(step * factor * sample_rate - 1.0) <= _SAME_RATE:
                return stamps * factor, f"`{column}` was read as {unit}, as the sample rate says"
        return stamps, ""
    suits = [unit for unit, factor in _PARTS.items() if _USUAL[0] <= 1.0 / (step * factor) <= _USUAL[1]]
    slow = f"`{column}` has no unit, and in s its sample rate would be {1.0 / step:.4g} Hz"
    if not suits:
        return stamps, ""
    if len(suits) == 1 and not counts:
        return stamps * _PARTS[suits[0]], f"{slow}: it was read as {suits[0]} (--unit t=s keeps s)"
    options = [f"`--unit t={unit}` for {1.0 / (step * _PARTS[unit]):.5g} Hz" for unit in suits]
    options += ["`--sample-rate HZ` where it counts samples"] if counts else []
    options += ["`--unit t=s` for s"]
    raise InputError(
        slow, file=file, cure=f"Say which it is, here or as `units` of a case file: {', '.join(options)}"
    )


def on_one_clock(
    values: dict[str, Float[np.ndarray, " _"]], names: dict[str, str], table: AbstractColumnTable
) -> tuple[dict[str, Float[np.ndarray, " _"]], tuple[str, ...]]:
    """Channels with clocks of their own at the times of x: the input held, the others on straight lines.

    **Arguments:**

    - `values`: role -> values as the file has them.
    - `names`: role -> column.
    - `table`: the file, which knows the clocks.

    **Returns:** role -> values, with the times of x as `t` where no column is time, as far as every clock runs; and
    sentences on what was brought to other times.

    **Raises:** `InputError` for a clock without one time a sample, and for differing clocks that do not run forward.
    """
    clock = table.clock(names.get("x") or names["v"])
    if clock is None or "t" in values:
        return values, ()
    own = {role: times for role, name in names.items() if (times := table.clock(name)) is not None}
    differ = any(not np.array_equal(times, clock) for times in own.values())
    for role, times in own.items():
        _require_clock(times, values[role].size, names[role], table, must_rise=differ)
    first, last = max(times[0] for times in own.values()), min(times[-1] for times in own.values())
    kept = np.flatnonzero((clock >= first) & (clock <= last))
    said, brought = [], {"t": clock[kept]}
    for role, channel in values.items():
        times = own.get(role)
        if times is None:
            brought[role] = channel
        elif np.array_equal(times, clock):
            brought[role] = channel[kept]
        elif role == "u":
            brought[role] = channel[np.searchsorted(times, clock[kept], side="right") - 1]
            said.append("u has a clock of its own: it was held until the times of x")
        else:
            brought[role] = np.interp(clock[kept], times, channel)
            said.append(f"{role} has a clock of its own: it was interpolated at the times of x")
    return brought, tuple(said)


def _require_clock(
    times: Float[np.ndarray, " _"], samples: int, name: str, table: AbstractColumnTable, *, must_rise: bool
) -> None:
    """Raise `InputError` unless the clock of the channel `name` has a time for each of its `samples`."""
    if not samples or times.size != samples:
        problem = f"the channel `{shown(name)}` has {samples} samples, and its clock {times.size} times"
    elif must_rise and not (np.isfinite(times).all() and (np.diff(times) >= 0.0).all()):
        problem = f"the clock of `{shown(name)}` does not run forward"
    else:
        return
    raise InputError(
        problem, file=shown(table.path, 200), cure="Export the file again, with one clock for all"
    )
