"""From one entry of a case and its opened file to a `Recording`."""

import dataclasses
import warnings
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.recordings.audit import audit
from frictionjax.recordings.columns import Columns, read_columns
from frictionjax.recordings.integral import integral_of
from frictionjax.recordings.jumps import standing, unwrapped
from frictionjax.recordings.proposal import proposal
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.recording import Plant, Recording, Sampling
from frictionjax.recordings.sampling import TimeGrid, find_grid, punctual
from frictionjax.recordings.schema import ROLES, Entry
from frictionjax.recordings.simulated import SIMULATED, no_simulation, on_the_turn_of
from frictionjax.recordings.target import said_of_target
from frictionjax.recordings.words import shown

MIN_SAMPLES = 100
_OPTIONAL = ("v", "force", "reference", "temperature", "normal_force", "supply", "simulated")
# The rate written in the case and the one in the time stamps may differ by a clock's error, not by more.
_RATE_TOLERANCE = 1e-3
_SLOWEST, _FASTEST = 1e-3, 1e9  # Hz
MILLISECONDS = 'units = {t = "ms"} for ms (--unit t=ms)'
_INTEGRATED = (
    "There is no position: v was integrated. Its offset belongs to the base model, and positions count from the first "
    "sample of each recording."
)
_NOT_COMPARED = "There is no position that `simulated` could be compared with: it was left out."
# No measurement is larger, and sums of squares below it stay finite.
_LARGEST = 1e100


def make_recording(
    entry: Entry, table: AbstractColumnTable, chosen: Columns, name: str, plant: Plant
) -> Recording:
    """Read the channels that an entry names, check them and put them on a uniform grid.

    **Arguments:**

    - `entry`: the checked keys of the recording.
    - `table`: its opened file.
    - `chosen`: which of its columns is which.
    - `name`: the recording's name, unique in its case.
    - `plant`: the units that columns are converted to, and what the audit compares the data with.

    **Returns:** the `Recording`, with what the audit found among its `warnings`.

    **Raises:** `InputError` for anything in the file that makes the recording unusable; warns with
    `FrictionjaxWarning` when columns were found by names that people use, or converted, and when the channels had to
    be resampled.
    """
    file = shown(table.path, 200)
    columns, converted, left_out = read_columns(chosen, entry, table, plant)
    named = {role: chosen.names.get(role, role) for role in ROLES}
    read_as = tuple(f"{sentence}." for sentence in (*chosen.notes, *converted))
    motion = chosen.motion
    rows, late = np.arange(columns[motion].size), np.zeros(columns[motion].size, dtype=bool)
    if "t" in columns:
        _require_finite(columns["t"], table, named["t"], rows)
        rows = _not_repeated(columns)
        columns = {role: values[rows] for role, values in columns.items()}
        columns["t"], late = punctual(columns["t"])
    stamps, step = _time(entry, table, columns, columns[motion].size, file)
    first, last = _cut(entry, stamps, step, file)
    used = {role: values[first:last] for role, values in columns.items() if role != "t"}
    if SIMULATED in used and SIMULATED in chosen.guessed:
        none = no_simulation(used[SIMULATED], named[SIMULATED])
        if none:
            left_out = (*left_out, none)
            del used[SIMULATED]
        else:
            read_as = (*read_as, f"`{shown(named[SIMULATED], 40)}` was read as simulated.")
    if SIMULATED in used and motion == "v":
        left_out = (*left_out, _NOT_COMPARED)
        del used[SIMULATED]
    for role, values in used.items():
        _require_finite(values, table, named[role], rows[first:last])
    if last - first < MIN_SAMPLES:
        part = "the interval" if entry.interval else "the file"
        raise InputError(
            f"{part} holds {last - first} samples, too few to identify anything",
            file=file,
            place=entry.spot.at(),
            cure=f"Record at least {MIN_SAMPLES} samples, better several seconds",
        )
    if "t" in columns:
        if 0.0 < step < 1.0 / _FASTEST:  # so short that the arithmetic of the grid would overflow
            _require_usual_rate(1.0 / step, entry, file)
        grid = find_grid(stamps[first:last], table, named["t"], rows[first:last])
        rate = _agreed_rate(grid, entry, file)
    else:
        rate = entry.sample_rate or 1.0 / step
        grid = TimeGrid(rate, Sampling(), stamps[first:last], None)
    _require_usual_rate(rate, entry, file)
    _require_motion(entry, used, motion, file)
    if motion == "x":

        def place(sample: int) -> str:
            return f"{table.place(int(rows[first + sample]))}, column `{shown(named['x'])}`"

        used["x"], remarks = _without_turns(used["x"], rate, plant, place)
    else:
        remarks = (_INTEGRATED,)
    if SIMULATED in used:
        used[SIMULATED], wraps = on_the_turn_of(used[SIMULATED], entry.drive, plant)
        remarks = (*remarks, *wraps)
    x = np.ascontiguousarray(grid.follow(used[motion]))
    x = x if motion == "x" else integral_of(x, rate)
    u = np.ascontiguousarray(grid.hold(used["u"])) if "u" in used else np.zeros(x.size)
    remarks = (*remarks, *filter(None, (said_of_target(x, u, rate, plant),)))
    optional = {
        role: np.ascontiguousarray(grid.follow(used[role])) if role in used else None for role in _OPTIONAL
    }
    recording = Recording(
        name=name,
        sample_rate=rate,
        u=u,
        x=x,
        role=entry.role,
        loop=entry.loop,
        drive=entry.drive,
        start_time=entry.start_time + float(stamps[first] - stamps[0]),
        sampling=dataclasses.replace(
            grid.sampling,
            late=int(np.count_nonzero(late[first:last])),
            repeated=int(np.ptp(rows[first:last])) + 1 - (last - first),
        ),
        v=optional["v"],
        force=optional["force"],
        reference=optional["reference"],
        temperature=optional["temperature"],
        normal_force=optional["normal_force"],
        supply=optional["supply"],
        simulated=optional["simulated"],
        integrated=motion == "v",
    )
    found = audit(recording, plant)
    for said in filter(None, (*read_as, found.sampling_sentence(), *remarks)):
        warnings.warn(FrictionjaxWarning(f"{file}: {said}"), stacklevel=2)
    return dataclasses.replace(recording, warnings=(*read_as, *left_out, *remarks, *found.concerns()))


def _without_turns(
    x: Float[np.ndarray, " n"], rate: float, plant: Plant, place: Callable[[int], str]
) -> tuple[Float[np.ndarray, " n"], tuple[str, ...]]:
    """A measured position without its jumps by full turns, and sentences on these or on a sensor that skips; `place`
    says where in the file a sample stands."""
    x, turns, jump = unwrapped(x, plant.position_unit)
    if turns:
        return x, (f"x jumps by a full turn {_times(turns)}, first at {place(jump)}: it was unwrapped.",)
    stood = standing(x)
    if stood is None:
        return x, ()
    return x, (
        f"x stands still for up to {1e3 * stood.longest / rate:.3g} ms and then jumps, {_times(stood.count)}, "
        f"first at {place(stood.first)}: the sensor or its transfer skips, and what it skips looks like friction.",
    )


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _not_repeated(columns: dict[str, Float[np.ndarray, " n"]]) -> Int[np.ndarray, " m"]:
    """The rows that do not repeat the row before, time included: a logger that writes a frame twice adds nothing."""
    same = np.ones(columns["t"].size, dtype=bool)
    same[:1] = False
    for values in columns.values():
        same[1:] &= values[1:] == values[:-1]
    return np.flatnonzero(~same)


def _time(
    entry: Entry,
    table: AbstractColumnTable,
    columns: dict[str, Float[np.ndarray, " _"]],
    size: int,
    file: str,
) -> tuple[Float[np.ndarray, " n"], float]:
    """Time stamps in s of so many samples, from the column or from the sample rate, and their median step."""
    if "t" in columns:
        stamps = columns["t"]
        return stamps, float(np.median(np.diff(stamps))) if stamps.size > 1 else 1.0
    if entry.sample_rate is None:
        raise InputError(
            "the file has no time column `t`, and no sample_rate is given",
            file=file,
            place=entry.spot.at(),
            cure="Add sample_rate = 2000.0 (--sample-rate 2000), samples per second, or say which column is the time, "
            f"such as: {proposal(entry, table)}",
        )
    return np.arange(size) / entry.sample_rate, 1.0 / entry.sample_rate


def _cut(entry: Entry, stamps: Float[np.ndarray, " n"], step: float, file: str) -> tuple[int, int]:
    """First sample and end of the interval; the end's own sample is not part of it."""
    if entry.interval is None:
        return 0, stamps.size
    begin, end = entry.interval
    if not stamps.size or begin < stamps[0] - step or end > stamps[-1] + 1.5 * step:
        covers = f"covers {stamps[0]:.6g} s to {stamps[-1]:.6g} s" if stamps.size else "is empty"
        raise InputError(
            f"the interval [{begin:g}, {end:g}] reaches outside of the file, which {covers}",
            file=file,
            place=entry.spot.at("interval"),
            cure="Give times inside the file, in s",
        )
    inside = (stamps >= begin - 1e-6 * step) & (stamps < end - 1e-6 * step)
    where = np.flatnonzero(inside)
    return (int(where[0]), int(where[-1]) + 1) if where.size else (0, 0)


def _require_finite(
    values: Float[np.ndarray, " n"], table: AbstractColumnTable, column: str, rows: Int[np.ndarray, " n"]
) -> None:
    wrong = np.flatnonzero(~(np.abs(values) < _LARGEST))
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"the value is {'missing or NaN' if np.isnan(values[k]) else 'infinite or beyond 1e100'}"
            + (f" (and {wrong.size - 1} more like it)" if wrong.size > 1 else ""),
            file=shown(table.path, 200),
            place=f"{table.place(int(rows[k]))}, column `{shown(column)}`",
            cure="Correct the value, use a part without it (interval), or, with a time column, delete the line",
        )


def _agreed_rate(grid: TimeGrid, entry: Entry, file: str) -> float:
    """The sample rate of the time stamps, which must be the one that the case gives, if it gives one."""
    if entry.sample_rate is None:
        return grid.sample_rate
    if abs(entry.sample_rate - grid.sample_rate) > _RATE_TOLERANCE * grid.sample_rate:
        raise InputError(
            f"the time column says {grid.sample_rate:.6g} Hz and sample_rate says {entry.sample_rate:.6g} Hz",
            file=file,
            place=entry.spot.at("sample_rate"),
            cure=f"Remove sample_rate, or correct the unit of time: {MILLISECONDS}",
        )
    return entry.sample_rate


def _require_usual_rate(rate: float, entry: Entry, file: str) -> None:
    """Refuse a sample rate, Hz, that no recording has."""
    if not _SLOWEST <= rate <= _FASTEST:
        raise InputError(
            f"the sample rate is {rate:.3g} Hz",
            file=file,
            place=entry.spot.at(),
            cure=f"Correct sample_rate, or say the unit of time: {MILLISECONDS}",
        )


def _require_motion(entry: Entry, used: dict[str, Float[np.ndarray, " n"]], motion: str, file: str) -> None:
    """Refuse a recording without motion, which a column with this role shows, without input, or without force."""
    place = entry.spot.at()
    if np.ptp(used[motion]) == 0:
        what = "position" if motion == "x" else "velocity"
        raise InputError(
            f"{motion} is constant ({used[motion][0]:.6g}): nothing moved, or this is not the {what}",
            file=file,
            place=place,
            cure=f"Check the sensor and which column is {motion} (columns)",
        )
    if entry.drive == "force" and not used["u"].any():
        raise InputError(
            "u is zero throughout: no input was applied, or this is not the input",
            file=file,
            place=place,
            cure='Check which column is u (columns); when the motion is imposed, set drive = "motion"',
        )
    if entry.drive == "motion" and np.ptp(used["force"]) == 0:
        raise InputError(
            f"force is constant ({used['force'][0]:.6g}): it was not measured, or this is not the force",
            file=file,
            place=place,
            cure="Check the sensor and which column is force (columns)",
        )
