"""From the options of a command to a case, and from recordings to a case file."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frictionjax.cli.case_options import OPTIONS, CaseOptions

if TYPE_CHECKING:
    from frictionjax.recordings import Case

_BY_NAME = {"columns": "role", "units": "role", "scale": "role", "controller": "key"}
_BY_FILE = ("start_time", "interval")


def case_of(files: Sequence[Path], source: CaseOptions, *, needs_holdout: bool = True) -> "Case":
    """The case that the `files` and the options `source` describe: a case file, or recordings and options; a command
    that judges nothing `needs_holdout` not, as in `load_case`."""
    from frictionjax.core import InputError
    from frictionjax.recordings import case_from_files, load_case

    first, *others = names = [str(file) for file in files]
    case_files = [name for name in names if Path(name).suffix.lower() == ".toml"]
    given = options_of(files, source)
    limits: dict[str, Any] = {"limit": source.limit, "needs_holdout": needs_holdout}
    if not case_files:
        return case_from_files(names, given.pop("holdout", []), **limits, **given)
    if others or source.holdout:
        problem = "a case file lists its own recordings, so it is the only argument"
        raise InputError(problem, file=case_files[0], cure="Give one case file, or recordings only")
    for key in given:
        problem = f"`{OPTIONS[key]}` is for recordings without a case file"
        raise InputError(problem, file=first, cure=f"Write {key} into the case file")
    return load_case(first, allow_outside=source.allow_outside, **limits)


def options_of(files: Sequence[Path], source: CaseOptions) -> dict[str, Any]:
    """The keywords of `case_from_files` that the options `source`, beside these `files`, set."""
    from frictionjax.core import InputError

    count = len(files) + len(source.holdout or ())
    given: dict[str, Any] = {}
    for key, option in OPTIONS.items():
        value = getattr(source, key)
        if value is None:
            continue
        if key == "holdout":
            value = [str(file) for file in value]
        elif key in _BY_NAME:
            names = [name for name, _ in value]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice:
                raise InputError(f"`{option}` gives `{twice}` twice", cure=f"Give each {_BY_NAME[key]} once")
            value = dict(value)
        elif key in _BY_FILE:
            if len(value) not in (1, count):
                raise InputError(
                    f"`{option}` has {len(value)} values for {count} files",
                    cure="Give one for all files, or one for each: fitted files first, held-out files last",
                )
            value = value * count if len(value) == 1 else value
        given[key] = value
    return given


def case_file_text(case: "Case", files: Sequence[Path], source: CaseOptions, folder: Path) -> str:
    """A case file, TOML, to stand in `folder`, for the recordings that the `files` and the options `source` name and
    that were read as `case`; each key with what it means, and those without a value as comments."""
    given = options_of(files, source)
    plant = case.plant
    known = {
        "motor_constant": plant.motor_constant,
        "position_unit": _named_unit(plant.position_unit, "position", plant.position_shown),
        "force_unit": _named_unit(plant.force_unit, "force", plant.force_shown),
        "input_unit": _named_unit(plant.input_unit, "input", plant.input_shown),
        "encoder_step": plant.encoder_step,
        "inertia": plant.inertia,
        "hold": _unless(plant.hold, "zero"),
    }
    lines = [
        "# Recordings of one machine. A line that starts with # is not read: fill it in and take the # away.",
        f"name = {_toml(case.name)}",
        "",
        "[plant]",
        *(_line(key, known[key], *_PLANT[key]) for key in known),
    ]
    listed = [(file, "fit") for file in files] + [(file, "holdout") for file in source.holdout or ()]
    if any(not file.resolve().is_relative_to(folder.resolve()) for file, _ in listed):
        lines.insert(
            1, "# Recordings lie outside of the folder of this file: it is read with --allow-outside."
        )
    for place, (file, role) in enumerate(listed):
        values: dict[str, Any] = {"file": Path(os.path.relpath(file, folder)).as_posix(), "role": role}
        values |= {
            key: given[key] for key in ("loop", "drive", "sample_rate", "units", "scale") if key in given
        }
        values["columns"] = _columns_of(file, given)
        values |= {
            key: list(given[key][place]) if key == "interval" else given[key][place]
            for key in _BY_FILE
            if key in given
        }
        lines += ["", "[[recording]]"]
        lines += [_line(key, values.get(key), *_RECORDING[key]) for key in _RECORDING]
        lines += [f"# {sentence}" for sentence in _seen(case, place, len(listed))]
    lines += ["", *_controller_lines(given.get("controller"))]
    if len(listed) == 1:
        lines += [
            "",
            "# Of a single recording the last third is held out. A second one judges better:",
            "# [[recording]]",
        ]
        lines += ['# file = "another.csv"', '# role = "holdout"']
    return "\n".join(lines) + "\n"


def _controller_lines(given: dict[str, float] | None) -> list[str]:
    """The table of the controller, as comments where it is not `given`."""
    keys = [_line(key, (given or {}).get(key), *_CONTROLLER[key]) for key in _CONTROLLER]
    return ["[controller]" if given else "# [controller]", *keys]


def _columns_of(file: Path, given: dict[str, Any]) -> dict[str, str]:
    """Role -> column of a `file`, with what is `given` for all files."""
    from frictionjax.recordings.columns import find_columns
    from frictionjax.recordings.readers import open_table
    from frictionjax.recordings.schema import Spot, parse_entry

    keys = {key: given[key] for key in ("drive", "sample_rate", "columns") if key in given}
    return find_columns(parse_entry({"file": str(file), **keys}, Spot(None)), open_table(file)).names


def _seen(case: "Case", place: int, files: int) -> tuple[str, ...]:
    """What the audit says of the recording of a file, when each file is one recording."""
    from frictionjax.recordings import audit

    if len(case.recordings) != files:
        return ()
    return audit(case.recordings[place], case.plant).sentences()


def _named_unit(unit: str, unknown: str, shown: str) -> str | None:
    """What a case file says of a unit; nothing where it is `unknown`, or where results are shown in that of the files,
    which are read again."""
    return None if shown else _unless(unit, unknown)


def _unless(text: str, default: str) -> str | None:
    return None if text == default else text


def _line(key: str, value: Any, example: Any, meaning: str) -> str:
    written = f"{key} = {_toml(example if value is None else value)}"
    return f"{'# ' if value is None else ''}{written:<44}  # {meaning}"


def _toml(value: Any) -> str:
    """A value as TOML; text with JSON's escapes, which are TOML's."""
    import json

    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))


_PLANT: dict[str, tuple[Any, str]] = {
    "motor_constant": (1.0, "force or torque per input unit; without it every force is per input unit"),
    "position_unit": (
        "rad",
        'any text; columns with a unit are converted to it; "rad", "deg" and the like also say that x is an angle',
    ),
    "force_unit": ("N*m", "unit of force in the result"),
    "input_unit": ("A", "unit of u"),
    "encoder_step": (1e-6, "quantum of the position sensor, position units"),
    "inertia": (0.01, "known inertia or mass; without it, it is identified"),
    "hold": (
        "linear",
        'where u runs straight from sample to sample; "auto": the recordings decide; else u is held',
    ),
}
"""Key of `[plant]` -> an example and what it means."""
_RECORDING: dict[str, tuple[Any, str]] = {
    "file": ("run.csv", "relative to this file"),
    "role": ("fit", '"fit", or "holdout": judges the result, and is not fitted'),
    "loop": ("open", '"closed" where u answers to the measured x'),
    "drive": ("force", '"motion" where the position is imposed and the force is measured'),
    "start_time": (0.0, "s since power-on: a common clock for warm-up"),
    "sample_rate": (2000.0, "Hz, for a file without a time column"),
    "columns": ({"t": "Time", "u": "Current", "x": "Position"}, "which column is which, by header or number"),
    "units": ({"t": "ms", "x": "deg"}, "units of columns whose headers do not say them"),
    "scale": ({"u": -1.0}, "factors to the units above, such as a sign"),
    "interval": ([0.0, 12.5], "s of the file's own time: the part to use"),
}
"""Key of `[[recording]]` -> an example and what it means."""
_CONTROLLER: dict[str, tuple[Any, str]] = {
    "kp": (16.0, 'of the position, input unit per position unit, where loop = "closed"'),
    "ki": (40.0, "input unit per position unit and s"),
    "kd": (0.3, "input unit s per position unit"),
    "limit": (10.0, "largest |u| that it gives"),
    "rate": (1000.0, "Hz, of the controller; else that of the recordings"),
}
"""Key of `[controller]` -> an example and what it means."""
