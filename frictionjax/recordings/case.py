"""Cases: a plant and its recordings, from a case file or from bare files."""

import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from frictionjax.core import InputError
from frictionjax.recordings.channels import make_recording
from frictionjax.recordings.columns import (
    LABELS,
    Columns,
    find_columns,
    has_label,
    labelled,
    shown_as_read,
)
from frictionjax.recordings.controller_table import parse_controller
from frictionjax.recordings.copies import copied_from
from frictionjax.recordings.hold_out import hold_out_last_third
from frictionjax.recordings.limits import CASE_FILE, NESTING, reading
from frictionjax.recordings.model_table import parse_model
from frictionjax.recordings.readers import AbstractColumnTable, open_table, stem
from frictionjax.recordings.recording import Case, Plant, Recording
from frictionjax.recordings.schema import (
    CASE_KEYS,
    LONGEST_TEXT,
    Entry,
    Spot,
    known_keys,
    parse_entry,
    parse_plant,
    text,
)
from frictionjax.recordings.words import require_file, shown


def load_case(
    path: str | Path,
    *,
    allow_outside: bool = False,
    limit: float | None = None,
    needs_holdout: bool = True,
) -> Case:
    """Read a case file and every recording that it names.

    Paths in the file count from its folder. A file may occur more than once with different intervals; the
    recordings are then called `run`, `run_2`, ... `start_time` is that of the file's first sample: a recording
    that begins later in its file starts later.

    **Arguments:**

    - `path`: the case file, TOML.
    - `allow_outside`: whether it may name files outside of its own folder; links count by where they lead.
    - `limit`: the most that is read of one file, unpacked, GB; None: 0.5 GB.
    - `needs_holdout`: whether several recordings without one that is held out are refused; False to look at them.

    **Returns:** the `Case`; each recording's `warnings` contain what the audit found.

    **Raises:** `InputError`, one line with file, place and cure, for anything wrong in the case file or in a
    recording. Warns with `FrictionjaxWarning` for every recording that had to be resampled.
    """
    path = require_file(Path(path))
    source = shown(path, 200)
    table = _toml(path, source)
    spot = Spot(source)
    known_keys(table, CASE_KEYS, spot)
    folder = path.resolve().parent.name
    fallback = folder if path.stem == "case" and folder else path.stem
    with reading(limit):
        return _build(
            table, fallback, path.parent, spot, confined=not allow_outside, needs_holdout=needs_holdout
        )


def case_from_files(
    files: str | Path | Sequence[str | Path],
    holdout: str | Path | Sequence[str | Path] = (),
    *,
    motor_constant: float | None = None,
    sample_rate: float | None = None,
    name: str | None = None,
    position_unit: str | None = None,
    force_unit: str | None = None,
    input_unit: str | None = None,
    encoder_step: float | None = None,
    inertia: float | None = None,
    hold: str | None = None,
    loop: str | None = None,
    drive: str | None = None,
    start_time: float | Sequence[float] | None = None,
    interval: Sequence[float] | Sequence[Sequence[float]] | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    controller: Mapping[str, float] | None = None,
    limit: float | None = None,
    needs_holdout: bool = True,
) -> Case:
    """A case from bare files, all of one layout.

    **Arguments:**

    - `files`: one file or several, to fit.
    - `holdout`: one file or several, held out for validation. Of a single file without any, the last third is held
      out, with a warning.
    - `motor_constant`: force or torque per input unit; absent: every force is per input unit.
    - `sample_rate`: Hz, for files without a time column.
    - `name`: the case's name; absent: that of the first file.
    - `position_unit`, `force_unit`, `input_unit`: units, as text; absent: SI where a column has a unit, which is then
        what it is shown in if all files have the same one; else unknown.
    - `encoder_step`: quantum of the position sensor, position units; absent: unknown.
    - `inertia`: known inertia or mass; absent: to be identified.
    - `hold`: `"zero"` (default), `"linear"` or `"auto"`: what the input does between samples.
    - `loop`: `"open"` (default) or `"closed"`, for all files.
    - `drive`: `"force"` (default) or `"motion"`, for all files.
    - `start_time`: s since power-on of the first sample: one for all files, or one for each, the held-out ones last.
    - `interval`: the part to use, from and to, s of the file's own time: one for all files, or one for each.
    - `columns`: which column is which, by role; absent: columns are called `t`, `u`, `x`, ..., or have names that
        people use for these, with a warning.
    - `units`: units of columns whose headers do not say them, by role.
    - `scale`: factors to the units above, by role.
    - `controller`: `kp`, `ki`, `kd`, `limit` and `rate` of that of the recordings made in closed loop; absent: unknown.
    - `limit`, `needs_holdout`: as in `load_case`.

    **Returns:** the `Case`, as from `load_case`.

    **Raises:** `InputError` as `load_case` does.
    """
    shared = {"sample_rate": sample_rate, "loop": loop, "drive": drive}
    shared |= {
        "columns": None if columns is None else dict(columns),
        "units": None if units is None else dict(units),
        "scale": None if scale is None else dict(scale),
    }
    plant = {"motor_constant": motor_constant, "encoder_step": encoder_step, "inertia": inertia, "hold": hold}
    plant |= {"position_unit": position_unit, "force_unit": force_unit, "input_unit": input_unit}
    given = [(path, "fit") for path in _several(files)] + [(path, "holdout") for path in _several(holdout)]
    starts = _for_each("start_time", start_time, len(given), isinstance(start_time, int | float))
    one_interval = interval is not None and all(isinstance(bound, int | float) for bound in interval)
    intervals = _for_each("interval", interval, len(given), one_interval)
    table: dict[str, Any] = {
        "plant": plant,
        "recording": [
            {"file": str(path), "role": role, **shared, "start_time": start, "interval": part}
            for (path, role), start, part in zip(given, starts, intervals, strict=True)
        ],
    }
    if name is not None:
        table["name"] = name
    if controller is not None:
        table["controller"] = dict(controller)
    fallback = stem(Path(given[0][0])) if given else ""
    with reading(limit):
        return _build(table, fallback, Path(), Spot(None), needs_holdout=needs_holdout)


def case_from_table(table: dict[str, Any], name: str) -> Case:
    """A case from the keys of a case file, as a dictionary; `name` where it has none. Relative paths count from the
    working directory.

    **Raises:** `InputError` as `load_case` does.
    """
    return _build(table, name, Path(), Spot(None))


def _for_each(key: str, value: Any, files: int, single: bool) -> list[Any]:
    """The value of a key for each file: a `single` one for all of them."""
    if value is None or single:
        return [value] * files
    if len(value) != files:
        raise InputError(
            f"`{key}` has {len(value)} values for {files} files",
            cure="Give one for all files, or one for each: fitted files first, held-out files last",
        )
    return list(value)


def _several(files: str | Path | Sequence[str | Path]) -> Sequence[str | Path]:
    return [files] if isinstance(files, str | Path) else files


def _toml(path: Path, source: str) -> dict[str, Any]:
    """The case file's content; whatever is wrong with its syntax is one line."""
    try:
        if path.stat().st_size > CASE_FILE:
            problem = f"has {path.stat().st_size} bytes, more than a case file takes ({CASE_FILE})"
            raise InputError(problem, file=source, cure="Give a case file (TOML), which names the recordings")
        content = path.read_bytes().decode("utf-8-sig")
        _require_shallow(content, source)
        return tomllib.loads(content)
    except InputError:
        raise
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\s*\(at (?:line (\d+), column \d+|end of document)\)", str(error))
        place = f"line {found[1]}" if found and found[1] else "end of the file" if found else ""
        problem = str(error)[: found.start()] if found else str(error)
        raise InputError(
            f"not valid TOML: {shown(problem, 120)}",
            file=source,
            place=place,
            cure='Text stands in quotes, every line is key = value, recordings begin with "[[recording]]"',
        ) from None
    except (UnicodeDecodeError, RecursionError):
        raise InputError(
            "this is not a TOML text file", file=source, cure="Give a case file (TOML)"
        ) from None
    except ValueError:  # of Python's `int`, for thousands of digits
        problem = "a whole number has more digits than any quantity"
        raise InputError(problem, file=source, cure="Write it with an exponent, such as 1e6") from None
    except OSError as error:
        raise InputError(
            f"cannot be opened ({shown(error.strerror)})", file=source, cure="Check its rights"
        ) from None


def _require_shallow(content: str, source: str) -> None:
    """Refuse a key of many parts or levels, whose parser takes the square of their number."""
    for number, line in enumerate(content.split("\n"), start=1):
        key = re.match(r"[^=#]*", line)
        if key and key[0].count(".") > NESTING:
            raise InputError(
                f"a key of more than {NESTING} parts",
                file=source,
                place=f"line {number}",
                cure="A case file has keys such as name, [plant] and [[recording]]",
            )


def _build(
    table: dict[str, Any],
    fallback: str,
    folder: Path,
    spot: Spot,
    *,
    confined: bool = False,
    needs_holdout: bool = True,
) -> Case:
    """The case from its keys; `folder` is where relative paths begin, and which `confined` ones do not leave."""
    name = text(table, "name", spot) if "name" in table else shown(fallback, LONGEST_TEXT)
    plant_table = table.get("plant", {})
    if not isinstance(plant_table, dict):
        spot.fail("the plant is not a table", "plant", "Write [plant] on a line, and its keys below it")
    plant = parse_plant(plant_table, Spot(spot.source, "[plant]" if spot.source else ""))
    entries = _entries(table, spot, needs_holdout)
    if confined:
        for entry in entries:
            _require_inside(entry, folder)
    paths = [_path(entry, folder) for entry in entries]
    recordings: list[Recording] = []
    taken: set[str] = set()
    opened: dict[Path, AbstractColumnTable] = {}
    chosen: list[Columns] = []
    given, apart = plant, _Apart()
    for entry, path in zip(entries, paths, strict=True):
        if path not in opened:  # neighbours often share a file; older ones are let go
            opened = {path: open_table(path)}
        chosen.append(find_columns(entry, opened[path]))
        apart.add(entry, path, chosen[-1])
        plant = labelled(plant, chosen[-1], entry)
        # A name that is not UTF-8, or of unprintable characters, is written with escapes.
        unique = _unique(shown(stem(path), LONGEST_TEXT), taken)
        taken.add(unique.casefold())
        recordings.append(make_recording(entry, opened[path], chosen[-1], unique, plant))
    _require_units_everywhere(given, entries, chosen)
    _require_originals(recordings, entries)
    plant = shown_as_read(plant, given, chosen, entries)
    model = parse_model(table.get("model"), spot.source)
    controller = parse_controller(table.get("controller"), recordings, spot.source)
    case = Case(name, plant, recordings, model, controller)
    return hold_out_last_third(case) if len(recordings) == 1 else case


def _entries(table: dict[str, Any], spot: Spot, needs_holdout: bool) -> list[Entry]:
    """The checked recordings' keys: some to fit and, of several, some held out where a case `needs_holdout`."""
    tables = table.get("recording", [])
    if not isinstance(tables, list) or not all(isinstance(item, dict) for item in tables):
        spot.fail("recordings are a list of tables", "recording", "Write [[recording]] with double brackets")
    entries = []
    for number, item in enumerate(tables, start=1):
        file = item.get("file")
        label = file if isinstance(file, str) else ""
        entries.append(
            parse_entry(item, Spot(spot.source, f"recording {number}" if spot.source else "", label))
        )
    roles = {entry.role for entry in entries}
    if "fit" not in roles:
        cure = (
            'Add a [[recording]] with role = "fit"'
            if spot.source
            else "Give at least one file besides the holdout"
        )
        spot.fail("there is no recording to fit", cure=cure)
    if needs_holdout and len(entries) > 1 and "holdout" not in roles:
        cure = (
            'Mark at least one recording with role = "holdout"; a file may occur twice, with an interval each'
            if spot.source
            else "Name at least one file as holdout"
        )
        spot.fail(
            "no recording is held out: a model can only be validated on data that it was not fitted to",
            cure=cure,
        )
    return entries


def _path(entry: Entry, folder: Path) -> Path:
    path = folder / entry.file
    if entry.spot.source is None:
        return require_file(path)
    return require_file(path, said_in=entry.spot.source, place=entry.spot.at("file"))


def _require_inside(entry: Entry, folder: Path) -> None:
    """Refuse a file outside of the folder of the case file, whether there is one or not."""
    try:
        inside = (folder / entry.file).resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # no name that a file can have, or links in a circle
        inside = True
    if not inside:
        entry.spot.fail(
            f'"{shown(entry.file, 120)}" is outside of the folder of the case file',
            "file",
            "Move the recording there, or allow it: --allow-outside (allow_outside=True in Python)",
        )


class _Apart:
    """Refuses a holdout recording that shares samples with one to fit, as soon as the columns of both are known."""

    def __init__(self) -> None:
        self._earlier: dict[tuple[int, int, str], list[Entry]] = {}

    def add(self, entry: Entry, path: Path, columns: Columns) -> None:
        """The recording of an `entry`, with these `columns` of the file `path`."""
        everything = (-math.inf, math.inf)
        # Links to one file are one file; of other variables of it, or another joint, the answers differ.
        status = path.stat()
        before = self._earlier.setdefault((status.st_dev, status.st_ino, _answer(entry, columns)), [])
        for other in before:
            if entry.role == other.role:
                continue
            kept = entry if entry.role == "holdout" else other
            (a, b), (c, d) = entry.interval or everything, other.interval or everything
            if max(a, c) < min(b, d):
                kept.spot.fail(
                    f'the holdout shares samples of "{shown(kept.file)}" with a recording to fit, '
                    "so it cannot validate",
                    "interval" if kept.interval else "file",
                    "Use another file, or give both an interval, such that they do not overlap",
                )
        before.append(entry)


def _answer(entry: Entry, columns: Columns) -> str:
    """The column that a model has to predict."""
    return columns.names["force" if entry.drive == "motion" else columns.motion]


def _require_units_everywhere(plant: Plant, entries: list[Entry], chosen: list[Columns]) -> None:
    """Refuse a case, of which no unit is given, with a unit in some files and none in others."""
    for role in LABELS:
        pairs = [pair for pair in zip(entries, chosen, strict=True) if role in pair[1].names]
        with_unit = [role in columns.units or role in entry.scale for entry, columns in pairs]
        named = any(role in columns.units and role not in entry.scale for entry, columns in pairs)
        if named and not all(with_unit) and not has_label(plant, role):
            entry, _ = pairs[with_unit.index(False)]
            entry.spot.fail(
                f'"{shown(entry.file)}" gives no unit for {role}, and other files of the case do',
                f"units.{role}",
                f'Give it: units = {{{role} = "..."}} (--unit {role}=...), or {LABELS[role]} for all files',
            )


def _require_originals(recordings: list[Recording], entries: list[Entry]) -> None:
    """Refuse a holdout recording that is a copy of one to fit under another name, or nearly one."""
    fitted = [recording for recording in recordings if recording.role == "fit"]
    for kept, entry in zip(recordings, entries, strict=True):
        if kept.role != "holdout":
            continue
        other = copied_from(kept, fitted)
        if other is not None:
            entry.spot.fail(
                f'the holdout "{shown(kept.name)}" holds the same positions as "{shown(other.name)}", '
                "so it cannot validate",
                "file",
                "Hold out another recording",
            )


def _unique(name: str, taken: set[str]) -> str:
    """A name not taken yet, whatever its letter case: results are stored in files of these names, `taken` are the
    earlier ones in lower case."""
    candidate, number = name, 1
    while candidate.casefold() in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate
