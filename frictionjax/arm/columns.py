"""Which column of an arm's log is which joint's position or torque, by the names that people give to them."""

import re
from collections.abc import Mapping, Sequence

import equinox as eqx

from frictionjax.core import InputError
from frictionjax.recordings.readers import AbstractColumnTable
from frictionjax.recordings.synonyms import synonyms_of
from frictionjax.recordings.units import split_unit
from frictionjax.recordings.words import listed, nearest, shown

KEYS = ("t", "q", "tau")
"""What `columns` may name."""
_WORDS = {
    "q": (*synonyms_of("x", "motion"), "actual q", "measured q", "qpos", "joint pos"),
    "tau": (
        *("tau", "torque", "effort", "motor torque", "measured torque", "actual torque", "measured tau"),
        *("actual tau", "actual effort", "applied torque", "moment", "drehmoment"),
    ),
}
"""Quantity -> names that people use for it, in lower case, words apart by blanks, without the joint."""
_FILLERS = ("joint", "joints", "axis", "j")
"""Words beside the number of a joint."""
_MEANT = {"q": "position", "tau": "torque"}


class JointColumns(eqx.Module):
    """The columns of a log.

    **Attributes:** `q` and `tau` (a column for each joint, in one order), `joints` (their names in the model; empty
    where the columns are numbered), `t` (the column of time; empty: it is found as in every recording).
    """

    q: tuple[str, ...] = eqx.field(static=True)
    tau: tuple[str, ...] = eqx.field(static=True)
    joints: tuple[str, ...] = eqx.field(static=True)
    t: str = eqx.field(static=True, default="")


def joint_columns(
    table: AbstractColumnTable, joints: Sequence[str], columns: Mapping[str, str | Sequence[str]]
) -> JointColumns:
    """Find position and torque of each joint: as `columns` says, else by names of joints (`elbow.position`), else by
    their numbers (`q1`, `tau[0]`, `joint 3 position`).

    **Arguments:**

    - `table`: the opened file.
    - `joints`: names of the model's joints.
    - `columns`: `"q"` and `"tau"`: their columns in the order of the joints; `"t"`: the column of time.

    **Raises:** `InputError` for a column that is missing, and for joints that have a position and no torque.
    """
    file = shown(table.path, 200)
    _check_keys(columns)
    found, named = _by_name(table.names, joints), True
    if not any(found.values()):
        found, named = _by_number(table.names, file), False
    for key in ("q", "tau"):
        if key in columns:
            found[key] = dict(enumerate(_several(columns[key])))
            named = False
    if not found["q"] or not found["tau"]:
        key = "tau" if found["q"] else "q"
        raise InputError(
            f"there is no column with the {_MEANT[key]} of a joint",
            file=file,
            cure=f"Call them {key}1, {key}2, ..., or say which they are: `columns` ({_option(key)}); "
            f"the file has: {listed(table.names)}",
        )
    order = [joint for joint in joints if joint in {*found["q"], *found["tau"]}] if named else sorted(
        {*found["q"], *found["tau"]}
    )  # fmt: skip
    for key in ("q", "tau"):
        for label in order:
            if label not in found[key]:
                what = f"`{shown(label)}`" if named else f"number {label}"
                raise InputError(
                    f"there is no column with the {_MEANT[key]} of the joint {what}",
                    file=file,
                    cure=f"Add it, or say which columns are which: `columns` ({_option('q')} {_option('tau')})",
                )
            if not table.has(found[key][label]):
                near = nearest(found[key][label], table.names)
                hint = f"Did you mean `{shown(near)}`? " if near else ""
                raise InputError(
                    table.absence(found[key][label]),
                    file=file,
                    cure=f"{hint}The file has: {listed(table.names)}",
                )
    time = columns.get("t", "")
    return JointColumns(
        tuple(found["q"][label] for label in order),
        tuple(found["tau"][label] for label in order),
        tuple(order) if named else (),
        time if isinstance(time, str) else time[0],
    )


def _check_keys(columns: Mapping[str, str | Sequence[str]]) -> None:
    for key in columns:
        if key not in KEYS:
            raise InputError(
                f"`{shown(key)}` is no channel of an arm's log",
                place="`columns`",
                cure=f"Name: {', '.join(KEYS)}",
            )


def _several(names: str | Sequence[str]) -> list[str]:
    return [names] if isinstance(names, str) else list(names)


def _option(key: str) -> str:
    return f"--{key} COLUMN ..."


def _by_name(headers: Sequence[str], joints: Sequence[str]) -> dict[str, dict]:
    """Quantity -> joint -> the header that has both; the longest name of a joint wins."""
    found: dict[str, dict] = {"q": {}, "tau": {}}
    longest_first = sorted(joints, key=lambda joint: -len(_words(joint)))
    for header in headers:
        words = _words(header)
        for joint in longest_first:
            rest = _without(words, _words(joint))
            key = None if rest is None else _quantity(rest)
            if key is not None:
                found[key].setdefault(joint, header)
                break
    return found


def _by_number(headers: Sequence[str], file: str) -> dict[str, dict]:
    """Quantity -> number of a joint -> the header that has both."""
    found: dict[str, dict] = {"q": {}, "tau": {}}
    for header in headers:
        words = _words(header)
        numbers = [word for word in words if word.isdigit()]
        key = _quantity([word for word in words if not word.isdigit()])
        if key is None or len(numbers) != 1:
            continue
        number = int(numbers[0])
        if number in found[key]:
            raise InputError(
                f"`{shown(found[key][number])}` and `{shown(header)}` could both be the {_MEANT[key]} of the joint "
                f"number {number}",
                file=file,
                cure=f"Say which columns it is: `columns` ({_option(key)})",
            )
        found[key][number] = header
    return found


def _quantity(words: Sequence[str]) -> str | None:
    text = " ".join(words)
    bare = " ".join(word for word in words if word not in _FILLERS)
    return next((key for key, names in _WORDS.items() if text in names or bare in names), None)


def _words(header: str) -> list[str]:
    """The words and numbers of a `header`, in lower case, without its unit."""
    name, unit = split_unit(header)
    if unit.isdigit():  # tau[1]
        name = header
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return re.findall(r"[^\W\d_]+|\d+", name.lower())


def unit_in(header: str) -> bool:
    """Whether a column's `header` says its unit."""
    unit = split_unit(header)[1]
    return bool(unit) and not unit.isdigit()


def _without(words: list[str], part: list[str]) -> list[str] | None:
    """The `words` without the first run of them that is `part`; None where there is none."""
    for start in range(len(words) - len(part) + 1):
        if part and words[start : start + len(part)] == part:
            return words[:start] + words[start + len(part) :]
    return None
