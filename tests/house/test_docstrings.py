"""Every argument of every public function, and every field of every public class, stands in its docstring.

An argument of a method may be explained by its class.
"""

import dataclasses
import functools
import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from helpers_house import DOORS, home_of, public_names


def gaps(value: Any, name: str) -> list[str]:
    """What the docstrings of a function or class leave out, one sentence each."""
    return list(_class_gaps(value, name) if inspect.isclass(value) else _function_gaps(value, name))


def _function_gaps(function: Callable, name: str, doc: str | None = None) -> Iterator[str]:
    doc = doc if doc is not None else inspect.getdoc(function) or ""
    if not doc:
        yield f"{name} has no docstring."
        return
    for argument in inspect.signature(function).parameters:
        if argument not in ("self", "cls") and not argument.startswith("_") and not _stated(argument, doc):
            yield f"{name} does not say what `{argument}` is."


def _class_gaps(cls: type, name: str) -> Iterator[str]:
    doc = inspect.cleandoc(vars(cls).get("__doc__") or "")
    if not doc or doc.startswith(
        f"{cls.__name__}("
    ):  # the second is what dataclasses write where nothing stands
        yield f"{name} has no docstring."
        return
    if dataclasses.is_dataclass(cls):
        for field in dataclasses.fields(cls):
            if not field.name.startswith("_") and not _stated(field.name, doc):
                yield f"{name} does not say what `{field.name}` is."
    elif getattr(cls, "_is_protocol", False):
        if "__call__" in vars(cls):
            yield from _function_gaps(vars(cls)["__call__"], name, doc)
    elif inspect.isfunction(vars(cls).get("__init__")):
        yield from _function_gaps(vars(cls)["__init__"], name, doc)
    for part in vars(cls):
        member = inspect.getattr_static(cls, part)
        if part.startswith("_") or not _is_documentable(member):
            continue
        if isinstance(member, property | functools.cached_property):
            if not inspect.getdoc(getattr(cls, part)):
                yield f"{name}.{part} has no docstring."
        else:
            method = getattr(cls, part)
            own = inspect.getdoc(method) or ""
            yield from _function_gaps(method, f"{name}.{part}", own and f"{own}\n{doc}")


def _is_documentable(member: Any) -> bool:
    wrappers = (property, functools.cached_property, staticmethod, classmethod)
    return isinstance(member, wrappers) or inspect.isfunction(member)


def _stated(word: str, doc: str) -> bool:
    """Whether `word` stands inside a pair of backticks."""
    return any(
        re.search(rf"(?<!\w){re.escape(word)}(?!\w)", span) for span in re.findall(r"`+([^`]+)`+", doc)
    )


@pytest.mark.parametrize("door", DOORS)
def test_every_argument_is_documented(door):
    module = importlib.import_module(door)
    public = {name: getattr(module, name) for name in public_names(door)}
    found = []
    for name, value in public.items():
        if callable(value) and home_of(value) == "frictionjax":
            found += gaps(value, name)
    assert not found, "\n".join(found)


def _complete(u, *, rate):
    """Filter the input `u`, sampled at `rate` per second."""


def _incomplete(u, *, rate, order=2):
    """Filter the input `u` at `rate`, of some order."""


def _silent(u): ...


@dataclasses.dataclass
class _Complete:
    """Fields `a` and `b`."""

    a: int
    b: int

    def total(self, c):
        """a + b + `c`."""


@dataclasses.dataclass
class _Incomplete:
    """Field `a`, and b."""

    a: int
    b: int

    @property
    def half(self): ...

    def total(self, c):
        """All three."""


@dataclasses.dataclass
class _Generated:
    a: int


class _Plain:
    """Holds a thing."""

    def __init__(self, thing): ...


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (_complete, []),
        (_incomplete, ["`order`"]),
        (_silent, ["no docstring"]),
        (_Complete, []),
        (_Incomplete, ["`b`", "half has no docstring", "`c`"]),
        (_Generated, ["no docstring"]),
        (_Plain, ["`thing`"]),
    ],
)
def test_a_planted_gap_is_caught(value, words):
    found = gaps(value, "it")
    assert len(found) == len(words)
    assert all(word in sentence for word, sentence in zip(words, found, strict=True))
