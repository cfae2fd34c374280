"""What a file of a fit holds, read field by field, and the sentence for a field that is wrong."""

import dataclasses
import json
import math
from collections.abc import Iterator
from typing import Any, NoReturn

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError, Parameter
from frictionjax.estimation.batch import Batch
from frictionjax.estimation.fit import Problem
from frictionjax.estimation.least_squares import Setting
from frictionjax.estimation.parameters import Free, base_layout
from frictionjax.physics import Drive, LuGre, catalogue
from frictionjax.physics.effects import AbstractEffect
from frictionjax.recordings.words import listed, nearest, shown
from frictionjax.simulation import Gains

AGAIN = "Write the file again with `save_fit`"
FRICTION = tuple(parameter.name for parameter in LuGre.parameters)


def fields_of(form: type) -> tuple[str, ...]:
    """Names of the fields of a Module class `form`."""
    return tuple(field.name for field in dataclasses.fields(form))


class Table(eqx.Module):
    """A table of the file, asked for its fields by key; an `InputError` for one that is missing or of another kind.

    **Attributes:**

    - `content`: the table.
    - `path`: keys that lead to it, with dots, for messages; empty for the file itself.
    - `file`: the file, for messages.
    """

    content: dict[str, Any] = eqx.field(static=True)
    path: str = eqx.field(static=True)
    file: object = eqx.field(static=True)

    def fail(self, key: str, problem: str, cure: str = AGAIN) -> NoReturn:
        """Raise the `InputError` for the field `key`: `problem` and `cure` are sentences."""
        raise InputError(problem, file=self.file, place=f"field `{shown(self._at(key))}`", cure=cure)

    def table(self, key: str) -> "Table":
        """The table under `key`."""
        value = self._value(key)
        return (
            Table(value, self._at(key), self.file) if isinstance(value, dict) else self._not(key, "a table")
        )

    def tables(self) -> Iterator[tuple[str, "Table"]]:
        """Every key with the table under it."""
        return ((key, self.table(key)) for key in self.content)

    def listed(self, key: str) -> list["Table"]:
        """The list of tables under `key`."""
        value = self._value(key)
        if not isinstance(value, list):
            self._not(key, "a list")
        numbered = Table({str(i): entry for i, entry in enumerate(value)}, self._at(key), self.file)
        return [numbered.table(str(i)) for i in range(len(value))]

    def text(self, key: str) -> str:
        """The text under `key`."""
        value = self._value(key)
        return value if isinstance(value, str) else self._not(key, "text")

    def flag(self, key: str) -> bool:
        """The true or false under `key`."""
        value = self._value(key)
        return value if isinstance(value, bool) else self._not(key, "true or false")

    def number(self, key: str, null: float = math.nan) -> float:
        """The number under `key`; `null` is what null stands for."""
        value = _number(self._value(key), null)
        return self._not(key, "a number") if value is None else value

    def vector(self, key: str, size: int | None = None, null: float = math.nan) -> Float[np.ndarray, " q"]:
        """The list of `size` numbers under `key` (None: any number of them), shape `(q,)`; `null` as in `number`."""
        value = self._value(key)
        numbers = [_number(entry, null) for entry in value] if isinstance(value, list) else [None]
        if None in numbers or size not in (None, len(numbers)):
            self._not(key, f"a list of {'' if size is None else f'{size} '}numbers")
        return np.array(numbers, dtype=float)

    def matrix(self, key: str, size: int, null: float) -> Float[np.ndarray, "q q"]:
        """The `size` lists of `size` numbers under `key`, shape `(q, q)`; `null` as in `number`."""
        value = self._value(key)
        if not isinstance(value, list) or len(value) != size:
            self._not(key, f"a list of {size} rows")
        rows = Table({str(i): row for i, row in enumerate(value)}, self._at(key), self.file)
        return np.array([rows.vector(str(i), size, null) for i in range(size)]).reshape(size, size)

    def only(self, names: tuple[str, ...]) -> None:
        """Raise the `InputError` for a key that is not one of `names`: what it holds would be lost."""
        for key in self.content:
            if key not in names:
                self.fail(key, f"`{shown(key)}` is not known here", _instead(key, names))

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def _value(self, key: str) -> Any:
        if key not in self.content:
            self.fail(key, "the field is missing")
        return self.content[key]

    def _not(self, key: str, kind: str) -> NoReturn:
        self.fail(key, f"{shown(json.dumps(self.content[key]))} is not {kind}")


def drive_of(table: Table) -> Drive:
    """The drive in `table`, with its effects."""
    friction = table.table("friction")
    friction.only(FRICTION)
    return Drive(
        table.number("J"),
        LuGre(*(friction.number(name) for name in FRICTION)),
        table.number("motor_constant"),
        tuple(_effect(entry) for entry in table.listed("effects")),
    )


def problem_of(table: Table) -> Problem:
    """The problem in `table`: layout, start and prior, without recordings."""
    drive = drive_of(table.table("drive"))
    layout = tuple(
        Free(
            entry.text("path"),
            _parameter(entry, drive),
            entry.text("label"),
            entry.number("scale"),
            entry.number("upper", math.inf),
        )
        for entry in table.listed("layout")
    )
    start = jnp.asarray(table.vector("start"))
    if start.size < len(layout):
        table.fail("start", f"{start.size} numbers are too few for {len(layout)} free parameters")
    prior = jnp.asarray(table.vector("prior", start.size))
    none, nothing = jnp.zeros(0), jnp.zeros((0, 0))
    batch = Batch(nothing, nothing, nothing, none, none, none, none, 1, np.zeros(0, dtype=int))
    return Problem(layout, Setting(drive, batch, Gains(none, none), nothing, start, prior))


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


def _effect(table: Table) -> AbstractEffect:
    name, form, known = table.text("name"), table.text("form"), catalogue()
    if name not in known:
        table.fail("name", f"there is no effect `{shown(name)}`", _instead(name, tuple(known)))
    forms: dict[str, Any] = {cls.__name__: cls for cls in known[name]}
    if form not in forms:
        problem = f"the effect `{name}` has no form `{shown(form)}`"
        table.fail("form", problem, _instead(form, tuple(forms)))
    numbers, names = table.table("parameters"), fields_of(forms[form])
    numbers.only(names)
    return forms[form](**{key: numbers.number(key) for key in names})


def _parameter(table: Table, drive: Drive) -> Parameter:
    """What the free parameter of `table` is, from its path in `drive`."""
    known = {free.path: free.parameter for free in base_layout(drive, 1.0)}
    for index, effect in enumerate(drive.effects):
        known |= {f"effects.{index}.{p.name}": p for p in effect.strengths + effect.nuisances}
    path = table.text("path")
    if path not in known:
        table.fail("path", f"the drive has no parameter `{shown(path)}`", _instead(path, tuple(known)))
    return known[path]
