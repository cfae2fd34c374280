"""The keys of a case file, their types, and the error for a wrong one."""

from collections.abc import Iterable
from typing import Any, Literal, NoReturn

import equinox as eqx

from frictionjax.core import InputError
from frictionjax.recordings.recording import Plant
from frictionjax.recordings.units import MEASURED_IN, parse_unit
from frictionjax.recordings.words import listed, nearest, shown

ROLES = ("t", "u", "x", "v", "force", "reference", "temperature", "normal_force", "supply", "simulated")
CASE_KEYS = ("name", "plant", "recording", "model", "controller")
CONTROLLER_KEYS = ("kp", "ki", "kd", "limit", "rate")
PLANT_KEYS = (
    "motor_constant",
    "position_unit",
    "force_unit",
    "input_unit",
    "encoder_step",
    "inertia",
    "hold",
)
RECORDING_KEYS = (
    "file",
    "role",
    "loop",
    "drive",
    "start_time",
    "sample_rate",
    "columns",
    "units",
    "scale",
    "interval",
)

# No physical quantity in any unit is larger, nor smaller than its inverse.
_LARGEST = 1e60
_MOST_COLUMNS = 10**6
LONGEST_TEXT = 200  # characters of a name
_LONGEST_UNIT = 40
_LONGEST_PATH = 4096


class Spot(eqx.Module):
    """The place in the user's description, for messages.

    **Attributes:**

    - `source`: the case file as text; None when there is none (a case made from bare files).
    - `table`: the table in it, in words: "[plant]", "recording 2".
    - `label`: the file that the table speaks of, as it is written there.
    """

    source: str | None = eqx.field(static=True)
    table: str = eqx.field(static=True, default="")
    label: str = eqx.field(static=True, default="")

    def at(self, key: str = "", label: bool = False) -> str:
        """The place of a key of this table, in words; with `label`, the file that it speaks of as well."""
        table = f'{self.table} ("{shown(self.label)}")' if label and self.label and self.table else self.table
        return ", ".join(part for part in (table, f"key `{shown(key)}`" if key else "") if part)

    def fail(self, problem: str, key: str = "", cure: str = "") -> NoReturn:
        """Raise the `InputError` for a key of this table."""
        raise InputError(problem, file=self.source, place=self.at(key, label=True), cure=cure)


class Entry(eqx.Module):
    """One `[[recording]]` of a case, checked for itself, before its file is opened.

    **Attributes:** the keys of a case file, with their defaults; `columns`, `units` and `scale` by role, `interval` in
    s of the file's own time; `spot` for messages.
    """

    file: str = eqx.field(static=True)
    role: Literal["fit", "holdout"] = eqx.field(static=True)
    loop: Literal["open", "closed"] = eqx.field(static=True)
    drive: Literal["force", "motion"] = eqx.field(static=True)
    start_time: float = eqx.field(static=True)
    sample_rate: float | None = eqx.field(static=True)
    columns: dict[str, str] = eqx.field(static=True)
    units: dict[str, str] = eqx.field(static=True)
    scale: dict[str, float] = eqx.field(static=True)
    interval: tuple[float, float] | None = eqx.field(static=True)
    spot: Spot


def parse_plant(table: dict[str, Any], spot: Spot) -> Plant:
    """The plant from its table.

    **Arguments:**

    - `table`: keys of `[plant]`; those that are None count as absent.
    - `spot`: for messages.

    **Returns:** the `Plant`; what is absent is unknown.

    **Raises:** `InputError` for an unknown key, a wrong type, or a number out of range.
    """
    table = {key: value for key, value in table.items() if value is not None}
    known_keys(table, PLANT_KEYS, spot)
    constant = number(table, "motor_constant", spot)
    if constant is not None and constant <= 0:
        spot.fail(
            f"the motor constant is {constant:g}, it must be above zero",
            "motor_constant",
            "Leave it out when it is unknown"
            if constant == 0
            else "Make it positive; when a positive input moves x backwards, also set scale = {u = -1.0}",
        )
    units = ("position_unit", "force_unit", "input_unit")
    return Plant(
        motor_constant=constant,
        encoder_step=positive(table, "encoder_step", spot, "Leave it out when it is unknown"),
        inertia=positive(table, "inertia", spot, "Leave it out when it is to be identified"),
        hold=choice(table, "hold", ("zero", "linear", "auto"), spot),
        **{key: text(table, key, spot, longest=_LONGEST_UNIT) for key in units if key in table},
    )


def parse_entry(table: dict[str, Any], spot: Spot) -> Entry:
    """One recording's keys, checked.

    **Arguments:**

    - `table`: keys of `[[recording]]`; those that are None count as absent.
    - `spot`: for messages.

    **Returns:** the `Entry`, with the defaults.

    **Raises:** `InputError` for an unknown key or role, a wrong type, or a value out of range.
    """
    table = {key: value for key, value in table.items() if value is not None}
    known_keys(table, RECORDING_KEYS, spot)
    if "file" not in table:
        spot.fail("the recording has no file", "file", 'Add file = "run.csv"')
    columns = mapping(table, "columns", spot)
    units = mapping(table, "units", spot)
    scale = mapping(table, "scale", spot)
    start_time = number(table, "start_time", spot)
    return Entry(
        file=text(table, "file", spot, longest=_LONGEST_PATH),
        role=choice(table, "role", ("fit", "holdout"), spot),
        loop=choice(table, "loop", ("open", "closed"), spot),
        drive=choice(table, "drive", ("force", "motion"), spot),
        start_time=0.0 if start_time is None else start_time,
        sample_rate=positive(table, "sample_rate", spot, "Give the samples per second, such as 2000.0"),
        columns={role: _column(columns, role, spot) for role in columns},
        units={role: _unit(units, role, spot) for role in units},
        scale={role: _factor(scale, role, spot) for role in scale},
        interval=_interval(table, spot),
        spot=spot,
    )


def known_keys(table: Iterable[str], allowed: tuple[str, ...], spot: Spot, prefix: str = "") -> None:
    """Raise `InputError` for a key that is not allowed, with the nearest allowed one."""
    for key in table:
        if key not in allowed:
            near = nearest(key, allowed)
            hint = f"Did you mean `{near}`? " if near else ""
            spot.fail(f"unknown key `{shown(key)}`", prefix + key, f"{hint}Allowed here: {listed(allowed)}")


def number(table: dict[str, Any], key: str, spot: Spot, prefix: str = "") -> float | None:
    """The finite number under a key, or None when it is absent."""
    if key not in table:
        return None
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        spot.fail(
            f"a number is needed, not {_kind(value)}", prefix + key, f"Write {key} = 1.0, without quotes"
        )
    if abs(value) > _LARGEST or value != value:  # an integer too large for a float is caught here, too
        fault = "out of range" if abs(value) < float("inf") else "not a finite number"
        spot.fail(f"{shown(value, 20)} is {fault}", prefix + key, "Give a finite number of usual size")
    if 0 < abs(value) < 1 / _LARGEST:
        spot.fail(f"{value:g} is too small", prefix + key, "Check the exponent")
    return float(value)


def positive(table: dict[str, Any], key: str, spot: Spot, cure: str) -> float | None:
    """The number above zero under a key, or None when it is absent."""
    value = number(table, key, spot)
    if value is not None and value <= 0:
        spot.fail(f"{value:g} is not above zero", key, cure)
    return value


def text(table: dict[str, Any], key: str, spot: Spot, prefix: str = "", longest: int = LONGEST_TEXT) -> str:
    """The text under a key, of no more than `longest` characters."""
    value = table[key]
    if not isinstance(value, str):
        spot.fail(f"text is needed, not {_kind(value)}", prefix + key, f'Write {key} = "..." in quotes')
    if not value.strip():
        spot.fail("the text is empty", prefix + key, "Fill it in or leave the key out")
    if len(value) > longest:
        problem = f"a text of {len(value)} characters, where no more than {longest} are of use"
        spot.fail(problem, prefix + key, "Shorten it")
    return value


def choice(table: dict[str, Any], key: str, allowed: tuple[str, ...], spot: Spot) -> Any:
    """One of the allowed words under a key; the first of them when the key is absent."""
    value = table.get(key, allowed[0])
    if value not in allowed:
        words = " or ".join(f'"{word}"' for word in allowed)
        spot.fail(f'"{shown(value)}" is not a {key}', key, f"Write {words}")
    return value


def mapping(table: dict[str, Any], key: str, spot: Spot) -> dict[str, Any]:
    """The inline table under a key, whose keys are column roles."""
    value = table.get(key, {})
    if not isinstance(value, dict):
        examples = {"columns": '{x = "position"}', "units": '{x = "mm"}', "scale": "{x = 1e-3}"}
        spot.fail(f"a table is needed, not {_kind(value)}", key, f"Write {key} = {examples[key]}")
    known_keys(value, ROLES, spot, f"{key}.")
    return value


def _column(columns: dict[str, Any], role: str, spot: Spot) -> str:
    """The column for a `role`: its name, or its number from 1 on."""
    value = columns[role]
    if isinstance(value, int) and not isinstance(value, bool):
        if not 1 <= value <= _MOST_COLUMNS:
            spot.fail(
                f"{shown(value, 20)} is not the number of a column", f"columns.{role}", "They count from 1"
            )
        return str(value)
    return text(columns, role, spot, "columns.")


def _unit(units: dict[str, Any], role: str, spot: Spot) -> str:
    """The unit of a `role`'s column: one that can be converted."""
    value = text(units, role, spot, "units.")
    unit = parse_unit(value)
    if unit is None:
        cure = 'Write a unit such as "ms", "deg", "mm", "mA", "N*m" or "turn/4096", or the factor (scale)'
        spot.fail(f'"{shown(value)}" is not a unit that is known', f"units.{role}", cure)
    if unit.powers not in MEASURED_IN.get(role, (unit.powers,)):
        spot.fail(
            f'"{shown(value)}" is {unit.measures}, and {role} is not',
            f"units.{role}",
            "Correct the unit or the role",
        )
    return value


def _factor(scale: dict[str, Any], role: str, spot: Spot) -> float:
    factor = number(scale, role, spot, "scale.")
    if not factor:
        spot.fail(
            "a factor of zero makes the column zero", f"scale.{role}", "Give the factor to the units above"
        )
    return factor


def _interval(table: dict[str, Any], spot: Spot) -> tuple[float, float] | None:
    value = table.get("interval")
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2 or any(isinstance(v, str) for v in value):
        spot.fail("two times are needed", "interval", "Write interval = [0.0, 12.5], in s")
    first, last = (number({"interval": time}, "interval", spot) for time in value)
    if first is None or last is None or last <= first:
        spot.fail(
            f"the interval [{first:g}, {last:g}] ends before it begins",
            "interval",
            "Write the earlier time first",
        )
    return first, last


def _kind(value: object) -> str:
    """A TOML value's type, in words."""
    kinds: dict[type, str] = {
        bool: "true or false",
        str: "text",
        list: "a list",
        dict: "a table",
        int: "a number",
        float: "a number",
    }
    return kinds.get(
        type(value), "a date or time" if hasattr(value, "isoformat") else f"a {type(value).__name__}"
    )
