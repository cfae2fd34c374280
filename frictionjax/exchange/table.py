"""The fields of a fit file, read one by one, with an error message for each that is wrong."""

import dataclasses
import json
import math
from collections.abc import Iterator
from typing import Any, NoReturn, cast

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.physics import Drive, LuGre, VelocityOffset, catalogue
from frictionjax.physics.effects import AbstractEffect
from frictionjax.recordings.words import listed, nearest, shown

AGAIN = "Write the file again with `save_fit`"
DRIVE = ("J", "motor_constant", "friction", "effects")
HOLDS = ("zero", "linear")
"""What an input may do between samples; the first where a file says nothing."""
FRICTION = tuple(parameter.name for parameter in LuGre.parameters)
EFFECT = ("name", "form", "parameters")


def fields_of(form: type) -> tuple[str, ...]:
    """Names of the fields of a Module class `form`."""
    return tuple(field.name for field in dataclasses.fields(form))


class FieldTable(eqx.Module):
    """A table of the file whose fields are read by key; an `InputError` for one that is missing or of another kind.

    **Attributes:**

    - `content`: the table.
    - `path`: keys that lead to it, with dots, for messages; empty for the file itself.
    - `file`: the file, for messages.
    - `again`: how to make a file that is right, as a sentence.
    """

    content: dict[str, Any] = eqx.field(static=True)
    path: str = eqx.field(static=True)
    file: object = eqx.field(static=True)
    again: str = eqx.field(static=True, default=AGAIN)

    def fail(self, key: str, problem: str, cure: str = "") -> NoReturn:
        """Raise the `InputError` for the field `key`: `problem` and `cure` are sentences; no cure: `again`."""
        raise InputError(
            problem, file=self.file, place=f"field `{shown(self._at(key))}`", cure=cure or self.again
        )

    def table(self, key: str) -> "FieldTable":
        """The table under `key`."""
        value = self._value(key)
        return (
            FieldTable(value, self._at(key), self.file, self.again)
            if isinstance(value, dict)
            else self._not(key, "a table")
        )

    def tables(self) -> Iterator[tuple[str, "FieldTable"]]:
        """Every key with the table under it."""
        return ((key, self.table(key)) for key in self.content)

    def listed(self, key: str) -> list["FieldTable"]:
        """The list of tables under `key`."""
        value = self._value(key)
        if not isinstance(value, list):
            self._not(key, "a list")
        numbered = FieldTable(
            {str(i): entry for i, entry in enumerate(value)}, self._at(key), self.file, self.again
        )
        return [numbered.table(str(i)) for i in range(len(value))]

    def text(self, key: str) -> str:
        """The text under `key`."""
        value = self._value(key)
        return value if isinstance(value, str) else self._not(key, "text")

    def texts(self, key: str) -> tuple[str, ...]:
        """The list of texts under `key`, none of them twice."""
        value = self._value(key)
        if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
            self._not(key, "a list of texts")
        if len(set(value)) < len(value):
            self._not(key, "a list of different texts")
        return tuple(value)

    def flag(self, key: str) -> bool:
        """The true or false under `key`."""
        value = self._value(key)
        return value if isinstance(value, bool) else self._not(key, "true or false")

    def number(self, key: str, null: float = math.nan) -> float:
        """The number under `key`; `null` is what null stands for."""
        value = _number(self._value(key), null)
        return self._not(key, "a number") if value is None else value

    def matrix(self, key: str, size: int, null: float = math.nan) -> Float[np.ndarray, "p p"]:
        """The `size` lists of `size` numbers under `key`, shape `(p, p)`; `null` as in `number`."""
        value = self._value(key)
        if not isinstance(value, list) or len(value) != size:
            self._not(key, f"a list of {size} rows")
        rows = FieldTable({str(i): row for i, row in enumerate(value)}, self._at(key), self.file, self.again)
        return np.array([rows._row(str(i), size, null) for i in range(size)], dtype=float).reshape(size, size)

    def only(self, names: tuple[str, ...]) -> None:
        """Raise the `InputError` for a key that is not one of `names`: its value would be ignored."""
        for key in self.content:
            if key not in names:
                self.fail(key, f"`{shown(key)}` is not known here", _instead(key, names))

    def _row(self, key: str, size: int, null: float) -> list[float]:
        value = self._value(key)
        numbers = [_number(entry, null) for entry in value] if isinstance(value, list) else []
        found = [number for number in numbers if number is not None]
        return found if len(found) == len(numbers) == size else self._not(key, f"a list of {size} numbers")

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def _value(self, key: str) -> Any:
        if key not in self.content:
            self.fail(key, "the field is missing")
        return self.content[key]

    def _not(self, key: str, kind: str) -> NoReturn:
        self.fail(key, f"{shown(json.dumps(self.content[key]))} is not {kind}")


def drive_of(table: FieldTable) -> Drive:
    """The drive in `table`, with its effects."""
    table.only((*DRIVE, "hold"))
    hold = table.text("hold") if "hold" in table.content else HOLDS[0]
    if hold not in HOLDS:
        table.fail("hold", f'"{shown(hold)}" is no hold of the input', f"Write {' or '.join(HOLDS)}")
    friction = table.table("friction")
    friction.only(FRICTION)
    return Drive(
        table.number("J"),
        LuGre(*(friction.number(name) for name in FRICTION)),
        table.number("motor_constant"),
        tuple(_effect(entry) for entry in table.listed("effects")),
        cast(Any, hold),
    )


def _number(value: Any, null: float) -> float | None:
    """`value` as a finite float, `null` for None; None when it is neither."""
    if value is None:
        return null
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _instead(word: str, names: tuple[str, ...]) -> str:
    near = nearest(word, names)
    hint = f"Did you mean `{near}`? " if near else ""
    return f"{hint}Known here: {listed(names)}. A file of a newer frictionjax needs that version"


def _effect(table: FieldTable) -> AbstractEffect:
    table.only(EFFECT)
    known = catalogue() | {VelocityOffset.name: (VelocityOffset,)}
    name, form = table.text("name"), table.text("form")
    if name not in known:
        table.fail("name", f"there is no effect `{shown(name)}`", _instead(name, tuple(known)))
    forms: dict[str, Any] = {cls.__name__: cls for cls in known[name]}
    if form not in forms:
        problem = f"the effect `{name}` has no form `{shown(form)}`"
        table.fail("form", problem, _instead(form, tuple(forms)))
    numbers, names = table.table("parameters"), fields_of(forms[form])
    numbers.only(names)
    return forms[form](**{key: numbers.number(key) for key in names})
