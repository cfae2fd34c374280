"""What to write where columns were not recognised: one complete option, with the likeliest column for each role."""

import json
import re

from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.schema import Entry
from frictionjax.recordings.synonyms import columns_like, plain_name, synonyms_of
from frictionjax.recordings.units import MEASURED_IN, parse_unit, split_unit
from frictionjax.recordings.words import listed, shown

FILL_IN = "FILL_IN"
"""Stands in a proposal for a column that nothing points to."""
_LONGEST = 40  # characters of a name that is copied; a longer one goes by its number
_DRIVES = ((("A", 1),), (("V", 1),), (("N", 1),), (("N", 1), ("m", 1)))
"""Units of an input."""
_NOT_MEASURED = {
    *("target", "reference", "ref", "setpoint", "desired", "demand", "command", "commanded", "cmd", "error"),
    *("soll", "sollwert", "fehler"),
}
"""Words in the name of a position that no sensor gives."""


def needed_roles(entry: Entry) -> tuple[str, ...]:
    """The roles that a recording needs, time only where its rate is not given."""
    roles = ("x", "force") if entry.drive == "motion" else ("u", "x")
    return roles if entry.sample_rate is not None else ("t", *roles)


def suits(role: str, name: str, table: AbstractColumnTable) -> bool:
    """Whether a column is of numbers, in a unit that suits the role."""
    unit = table.unit(name) or split_unit(name)[1]
    known = parse_unit(unit)
    measured = role not in MEASURED_IN or (
        known.powers in MEASURED_IN[role] if known else role != "t" or not unit
    )
    return measured and table.has(name)


def proposal(entry: Entry, table: AbstractColumnTable) -> str:
    """What says which column has which role, to be copied: an option, or a line of a case file.

    **Arguments:**

    - `entry`: the checked keys of the recording.
    - `table`: its opened file.

    **Returns:** a clause: `columns` of every role that is needed, `FILL_IN` where nothing points to a column; and the
    columns that are left.
    """
    found = _guesses(entry, table)
    left = [name for name in table.names if name not in found.values()]
    named = {role: _reference(name, table) for role, name in found.items()}
    if entry.spot.source is None:
        option = f"--columns {' '.join(f'{role}={_quoted(name)}' for role, name in named.items())}"
    else:
        pairs = ", ".join(f"{role} = {json.dumps(name, ensure_ascii=False)}" for role, name in named.items())
        option = f"columns = {{{pairs}}}"
    if FILL_IN not in found.values():
        return f"{option}; other columns: {listed(left)}" if left else option
    if left:
        return f"{option}, with one of these for {FILL_IN}: {listed(left)}"
    return f"{option}; the file has no other column for {FILL_IN}"


def _guesses(entry: Entry, table: AbstractColumnTable) -> dict[str, str]:
    """Role -> the likeliest column, by the case, then by its whole name, a word of it, its unit, and what is left."""
    roles = needed_roles(entry)
    found: dict[str, str] = {}
    for certain in (_given, _by_name, _by_word, _by_unit):
        for role in roles:
            free = tuple(name for name in table.names if name not in found.values())
            if role not in found and (name := certain(role, entry, table, free)) is not None:
                found[role] = name
    missing = [role for role in roles if role not in found]
    free = [name for name in table.names if name not in found.values()]
    if len(missing) == len(free) == 1 and suits(missing[0], free[0], table):
        found[missing[0]] = free[0]
    return {role: found.get(role, FILL_IN) for role in roles}


def looks_like_position(entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> bool:
    """Whether a word or the unit of one of the `free` columns points to a position, though its name does not say so."""
    return any(like("x", entry, table, free) is not None for like in (_by_word, _by_unit))


def _given(role: str, entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> str | None:
    """The column that the case names, where there is one, or that has the role as its name."""
    name = entry.columns.get(role, role)
    if name in free and table.has(name):
        return name
    like = [other for other in free if split_unit(other)[0] == name and table.has(other)]
    return like[0] if len(like) == 1 else None


def _by_name(role: str, entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> str | None:
    like = columns_like(role, entry.drive, free, guess=True)
    return next((name for name in like if suits(role, name, table)), None)


def _by_word(role: str, entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> str | None:
    """The first column with a word in its name that people use for the role."""
    known = {role, *(word for word in synonyms_of(role, entry.drive) if " " not in word and len(word) > 1)}
    for name in free:
        words = set(plain_name(name).split())
        if words & known and not (role == "x" and words & _NOT_MEASURED) and suits(role, name, table):
            return name
    return None


def _by_unit(role: str, entry: Entry, table: AbstractColumnTable, free: tuple[str, ...]) -> str | None:
    """The column whose unit suits the role, where it is the only one."""
    wanted = MEASURED_IN.get(role, _DRIVES)
    units = {name: parse_unit(table.unit(name) or split_unit(name)[1]) for name in free}
    like = [
        name for name, unit in units.items() if unit is not None and unit.powers in wanted and table.has(name)
    ]
    return like[0] if len(like) == 1 else None


def _reference(name: str, table: AbstractColumnTable) -> str:
    """What names a column: its name; its number where that cannot be copied or a shell would read more into it."""
    awkward = len(name) > _LONGEST or not name.isprintable() or re.search(r'["$`\\!%]', name)
    number = str(table.names.index(name) + 1) if name in table.names else ""
    return number if awkward and number and table.has(number) else shown(name)


def _quoted(name: str) -> str:
    return name if re.fullmatch(r"[\w.\-]+", name) else f'"{name}"'
