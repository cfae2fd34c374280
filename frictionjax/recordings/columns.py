"""Which column of a file has which role, in which unit, and its values in the units of the case."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.recordings.clock import contradicts, on_one_clock, seconds
from frictionjax.recordings.proposal import looks_like_position, proposal, suits
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.recording import Plant
from frictionjax.recordings.schema import ROLES, Entry
from frictionjax.recordings.simulated import SIMULATED, answer_of
from frictionjax.recordings.synonyms import columns_like
from frictionjax.recordings.units import MEASURED_IN, Unit, is_unit, parse_unit, split_unit
from frictionjax.recordings.words import listed, nearest, shown

LABELS = {"x": "position_unit", "force": "force_unit", "u": "input_unit"}
"""Role -> the field of `Plant` with its unit."""
SHOWN = {"x": "position_shown", "force": "force_shown", "u": "input_shown"}
"""Role -> the field of `Plant` with the unit in which it is shown."""


class Columns(eqx.Module):
    """The columns of a recording.

    **Attributes:**

    - `names`: role -> the column's name in the file.
    - `units`: role -> the column's unit, as text; roles without one are absent.
    - `notes`: which columns were found by names that people use, as sentences.
    - `guessed`: the roles of these.

    A recording without a position has the role v in its place, whose integral the position is.
    """

    names: dict[str, str] = eqx.field(static=True)
    units: dict[str, str] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)
    guessed: frozenset[str] = eqx.field(static=True, default=frozenset())

    @property
    def motion(self) -> str:
        """The role of the column that shows the motion: x, or v where only the velocity was recorded."""
        return "x" if "x" in self.names else "v"


def find_columns(entry: Entry, table: AbstractColumnTable) -> Columns:
    """Find the column of each role: the one that the case names, that has the role as its name (with or without a
    unit), or, for a role that the recording needs, that has a name which people use for it.

    **Arguments:**

    - `entry`: the checked keys of the recording.
    - `table`: its opened file.

    **Returns:** the `Columns`.

    **Raises:** `InputError` when a column is not there, two could be meant, or one would have two roles.
    """
    motion = entry.drive == "motion"
    if motion and "u" in entry.columns:
        entry.spot.fail(
            'with drive = "motion" there is no input',
            "columns.u",
            "Remove u, or name the measured force: force",
        )
    needed = ("x", "force") if motion else ("x", "u")
    roles = list(dict.fromkeys((*needed, *(role for role in ROLES if not (motion and role == "u")))))
    names = {role: _named(role, entry, table) for role in roles if role in entry.columns}
    names |= {role: role for role in roles if role not in names and table.has(role)}
    guessed: dict[str, str] = {}
    unsure: tuple[str, ...] = ()
    for role in roles:
        if role in names:
            continue
        free = tuple(name for name in table.names if name not in names.values())
        must = role in needed or (role == "t" and entry.sample_rate is None)
        like = columns_like(role, entry.drive, free, guess=must or role == SIMULATED)
        like = [name for name in like if suits(role, name, table)]
        if len(like) == 1:
            names[role] = like[0]
            if split_unit(like[0])[0] != role:
                guessed[role] = like[0]
        elif like and role == SIMULATED:
            unsure = (f"{len(like)} columns could be simulated, and none was read: {listed(like)}",)
        elif like and must:
            raise _ambiguous(role, like, entry, table)
        elif role == "x" and not motion and (speeds := _velocities(entry, table, free)):
            if len(speeds) > 1 and "v" not in names:
                raise _ambiguous("v", speeds, entry, table)
            if "v" not in names:
                names["v"] = speeds[0]
                guessed |= {"v": speeds[0]} if split_unit(speeds[0])[0] != "v" else {}
        elif role in needed:
            raise _no_column(role, role, entry, table)
    _require_different(names, entry, table)
    names = {role: names[role] for role in ROLES if role in names}
    found = [
        role for role in names if role in guessed and role != SIMULATED
    ]  # of that one the values say more
    said = [(f"`{shown(guessed[role], 40)}`", "was read", f"as {role}") for role in found]
    notes = (*_in_one_sentence(said), *unsure)
    return Columns(names, _units(names, entry, table), notes, frozenset(guessed))


def labelled(plant: Plant, columns: Columns, entry: Entry) -> Plant:
    """The plant with the SI units of the `columns` where the case gives no unit.

    **Arguments:**

    - `plant`: as the case describes it.
    - `columns`: those of a recording.
    - `entry`: the keys of the recording: a column with a factor (scale) is in a unit that only the case can name.

    **Returns:** the `Plant`.
    """
    found: dict[str, Any] = {}
    for role, label in LABELS.items():
        if not has_label(plant, role) and role in columns.units and role not in entry.scale:
            unit = parse_unit(columns.units[role])
            found[label] = unit.si if unit else columns.units[role]
    if columns.motion == "v" and not has_label(plant, "x") and "v" not in entry.scale:
        unit = parse_unit(columns.units.get("v", ""))
        found |= {LABELS["x"]: unit.si.removesuffix("/s")} if unit else {}
    return dataclasses.replace(plant, **found)


def shown_as_read(plant: Plant, given: Plant, chosen: Sequence[Columns], entries: Sequence[Entry]) -> Plant:
    """The plant that shows each quantity in the unit of its columns, where all files have the same and it is not SI.

    **Arguments:**

    - `plant`: with the units of all recordings.
    - `given`: as the case describes it: a unit that it names is shown as well.
    - `chosen`: the columns of each recording.
    - `entries`: their keys: a column with a factor (scale) is in a unit of its own.

    **Returns:** the `Plant`. Parts of a unit, as of an encoder with 4096 counts a turn, are shown in SI.
    """
    found: dict[str, Any] = {}
    for role, label in SHOWN.items():
        texts = [
            "" if role in entry.scale else columns.units.get(role, "")
            for columns, entry in zip(chosen, entries, strict=True)
            if role in columns.names
        ]
        units = [parse_unit(text) for text in texts]
        own, first = parse_unit(getattr(plant, LABELS[role])), units[0] if units else None
        if own is None or first is None or has_label(given, role) or first.factor == own.factor:
            continue
        alike = all(unit is not None and unit.factor == first.factor for unit in units)
        if alike and not any(sign.isdigit() for sign in texts[0]):
            found[label] = texts[0]
    return dataclasses.replace(plant, **found)


def has_label(plant: Plant, role: str) -> bool:
    """Whether the `plant` names the unit of a `role` of `LABELS`."""
    return getattr(plant, LABELS[role]) != getattr(Plant(), LABELS[role])


def read_columns(
    columns: Columns, entry: Entry, table: AbstractColumnTable, plant: Plant
) -> tuple[dict[str, Float[np.ndarray, " _"]], tuple[str, ...], tuple[str, ...]]:
    """The values of the columns in the units of the case, on one clock.

    **Arguments:**

    - `columns`: what `find_columns` found.
    - `entry`: the checked keys of the recording.
    - `table`: its opened file.
    - `plant`: the units of the case.

    **Returns:** role -> values; sentences on what was converted; sentences on columns that were left out.

    **Raises:** `InputError` for columns of different lengths, and for a unit that is not one of its role.
    """
    names = columns.names
    scale = _scale(columns, entry)
    for role in entry.scale:
        if role not in names:
            entry.spot.fail(
                f"the recording has no column for `{role}`", f"scale.{role}", f"Scale one of: {listed(names)}"
            )
    for role in entry.units:
        if role not in names:
            entry.spot.fail(
                f"the recording has no column for `{role}`",
                f"units.{role}",
                f"Units are for: {listed(names)}",
            )
    values = dict(zip(names, table.read(list(names.values())), strict=True))
    values, said = on_one_clock(values, names, table)
    values, left_out = _of_one_length(values, names, entry, table)
    converted: list[tuple[str, str, str]] = []
    for role in list(values):
        factor, wanted = _factor(role, columns, entry, table, plant)
        given, sentence = shown(columns.units.get(role, "")), ""
        if role == "t" and "t" not in entry.scale and not given and "t" in names:
            file = shown(table.path, 200)
            values[role], sentence = seconds(values[role], names[role], entry.sample_rate, file)
        elif role == "t" and "t" not in entry.units and contradicts(values[role], factor):
            factor, sentence = 1.0, f"`{shown(names[role])}` is too fine for {given}: it was read as s"
        elif not factor:
            factor, sentence = (
                1.0,
                f"{role} is in {given} and the case has {shown(wanted)}: it was not converted",
            )
        elif factor != 1.0:
            converted.append((role, "was converted", f"from {given} to {shown(wanted)}"))
        with np.errstate(over="ignore"):
            values[role] = values[role] * scale.get(role, 1.0) * factor
        said += (sentence,) if sentence else ()
    return values, (*_in_one_sentence(converted), *said), left_out


def _in_one_sentence(parts: list[tuple[str, str, str]]) -> tuple[str, ...]:
    """Sentences of one verb as one: "`a` was read as t, `b` as u"; none of none."""
    if not parts:
        return ()
    (subject, verb, rest), *others = parts
    return (", ".join([f"{subject} {verb} {rest}", *(f"{other} {more}" for other, _, more in others)]),)


def _velocities(entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> list[str]:
    """The columns that could be the velocity of a recording without a position, among those that are `free`; none where
    one of these may be the position."""
    named = ("v",) if "v" in entry.columns or table.has("v") else ()
    like = columns_like("v", entry.drive, free, guess=True)
    rest = tuple(name for name in free if name not in like)
    if looks_like_position(entry, table, rest):
        return []
    return [*named] or [name for name in like if suits("v", name, table)]


def _named(role: str, entry: Entry, table: AbstractColumnTable) -> str:
    """The column that the case names for a role; it may leave out the unit in a header."""
    name = entry.columns[role]
    if table.has(name):
        return name
    like = [other for other in table.names if split_unit(other)[0] == name and table.has(other)]
    if len(like) != 1:
        raise _no_column(role, name, entry, table)
    return like[0]


def _units(names: dict[str, str], entry: Entry, table: AbstractColumnTable) -> dict[str, str]:
    """Role -> unit, as the case, the file or the header says."""
    units = {}
    for role, name in names.items():
        unit = entry.units.get(role) or table.unit(name) or split_unit(name)[1]
        if is_unit(unit):
            units[role] = unit.strip().strip("[]()")
    answer = answer_of(entry.drive)
    if SIMULATED in names and SIMULATED not in units and not {SIMULATED, answer} & {*entry.scale}:
        units |= {SIMULATED: units[answer]} if answer in units else {}
    return units


def _scale(columns: Columns, entry: Entry) -> dict[str, float]:
    """Role -> factor. A simulated answer without unit or factor of its own counts as the measured one does."""
    factor = entry.scale.get(answer_of(entry.drive))
    if factor is None or SIMULATED not in columns.names or SIMULATED in columns.units:
        return entry.scale
    return {SIMULATED: factor, **entry.scale}


def _require_different(names: dict[str, str], entry: Entry, table: AbstractColumnTable) -> None:
    owners: dict[str, str] = {}
    for role, name in names.items():
        if owners.setdefault(name, role) != role:
            entry.spot.fail(
                f"the column `{shown(name)}` is to be both {owners[name]} and {role}",
                f"columns.{role if role in entry.columns else owners[name]}",
                f"Name a column for each; the file has: {listed(table.names)}",
            )


def _of_one_length(
    values: dict[str, Float[np.ndarray, " _"]],
    names: dict[str, str],
    entry: Entry,
    table: AbstractColumnTable,
) -> tuple[dict[str, Float[np.ndarray, " _"]], tuple[str, ...]]:
    """The columns as long as x, and sentences on those that were left out."""
    motion = "x" if "x" in names else "v"
    needed = (motion, "force") if entry.drive == "motion" else (motion, "u")
    left_out, size = [], values[motion].size
    for role in list(values):
        if values[role].size == size:
            continue
        if role in needed or role in entry.columns or (role == "t" and entry.sample_rate is None):
            raise InputError(
                f"`{shown(names[role])}` ({role}) has {values[role].size} samples, "
                f"`{shown(names[motion])}` ({motion}) has {size}",
                file=shown(table.path, 200),
                place=entry.spot.at(),
                cure="Name columns of one and the same recording (columns), or cut them to one length",
            )
        left_out.append(f"`{role}` has {values[role].size} samples and {motion} has {size}: it was left out.")
        del values[role]
    return values, tuple(left_out)


def _factor(
    role: str, columns: Columns, entry: Entry, table: AbstractColumnTable, plant: Plant
) -> tuple[float, str]:
    """What a column is multiplied by to reach the unit of the case, and that unit; a factor of 0 where its unit cannot
    be converted to it."""
    text = columns.units.get(role, "")
    if not text or role in entry.scale:
        return 1.0, ""
    unit = parse_unit(text)
    if unit is None:
        label = answer_of(entry.drive) if role == SIMULATED else role
        wanted = getattr(plant, LABELS[label]) if label in LABELS else text
        return float(wanted == text), wanted
    if unit.powers not in MEASURED_IN.get(role, (unit.powers,)):
        raise InputError(
            f"the column `{shown(columns.names[role])}` is in {shown(text)}, {unit.measures}, and is to be {role}",
            file=shown(table.path, 200),
            place=entry.spot.at(f"columns.{role}"),
            cure=f"Name another column (columns), or the factor to the units of the case: scale = {{{role} = 1.0}}",
        )
    wanted = _wanted(role, unit, plant, entry.drive)
    target = parse_unit(wanted)
    if target is None:
        return 0.0, wanted
    if target.powers != unit.powers:
        raise InputError(
            f"the column `{shown(columns.names[role])}` is in {shown(text)}, {unit.measures}, and the case has {role} "
            f"in {shown(wanted)}, {target.measures}",
            file=shown(table.path, 200),
            place=entry.spot.at(),
            cure="Correct the unit of the case or that of the column (units)",
        )
    return unit.factor / target.factor, wanted


def _wanted(role: str, unit: Unit, plant: Plant, drive: str) -> str:
    """The unit that the case wants for a role: its own, or one that goes with it, else SI."""
    if role == SIMULATED:
        return getattr(plant, LABELS[answer_of(drive)])
    if role in LABELS and has_label(plant, role):
        return getattr(plant, LABELS[role])
    beside = {"v": f"{plant.position_unit}/s", "reference": plant.position_unit}.get(role, unit.si)
    target = parse_unit(beside)
    return beside if target is not None and target.powers == unit.powers else unit.si


def _ambiguous(role: str, like: list[str], entry: Entry, table: AbstractColumnTable) -> InputError:
    return InputError(
        f"there is no column `{role}`, and {len(like)} columns could be it: {listed(like)}",
        file=shown(table.path, 200),
        place=entry.spot.at(),
        cure=f"Say which column is which, such as: {proposal(entry, table)}",
    )


def _no_column(role: str, name: str, entry: Entry, table: AbstractColumnTable) -> InputError:
    """The error for a column that is not there."""
    near = nearest(name, table.names)
    hint = f"Did you mean `{shown(near)}`? " if near and near != name else ""
    say = f"Say which column is which, such as: {proposal(entry, table)}"
    if role == "force" and "force" not in entry.columns:
        hint = f'A recording with drive = "motion" needs the measured force. {hint}'
    return InputError(
        f"{table.absence(name)}, which is to be {role}" if name != role else table.absence(name),
        file=shown(table.path, 200),
        place=entry.spot.at(f"columns.{role}") if role in entry.columns else entry.spot.at(),
        cure=hint + say,
    )
