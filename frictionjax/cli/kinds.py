"""Kinds of options: how a value is read, and what stands for it in the help."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from cyclopts import Parameter, Token

from frictionjax.cli.terminal import Terminal

_Item = TypeVar("_Item")
_Read = Callable[[Any, Sequence[Token]], Any]


def _count(hint: Any, tokens: Sequence[Token]) -> int:
    text = tokens[0].value
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def _pairs(form: str, example: str, kind: Callable[[str], Any]) -> _Read:
    """Reads each value of an option as a name and what it is given, of this `kind`."""

    def pair(text: str) -> tuple[str, Any]:
        key, sign, given = text.partition("=")
        if not sign or not key.strip() or not given.strip():
            raise ValueError(f"{text!r} is not {form}, such as {example}; files stand before the options")
        try:
            return key.strip(), kind(given)
        except ValueError:
            raise ValueError(f"{given!r} in {text!r} is not a number") from None

    return lambda hint, tokens: [pair(token.value) for token in tokens]


def _intervals(hint: Any, tokens: Sequence[Token]) -> list[tuple[float, float]]:
    found = []
    for token in tokens:
        first, _, last = token.value.partition(":")
        try:
            found.append((float(first), float(last)))
        except ValueError:
            problem = f"{token.value!r} is not FROM:TO, such as 0:12.5; files stand before the options"
            raise ValueError(problem) from None
    return found


def named(form: str, example: str, kind: Callable[[str], Any] = str) -> Parameter:
    """An option with several values, each of which has a name.

    **Arguments:**

    - `form`: what stands for one of them in the help, ROLE=COLUMN
    - `example`: one of them
    - `kind`: reads what stands behind the =
    """
    return Parameter(
        converter=_pairs(form, example, kind), metavar=f"{form}...", n_tokens=1, consume_multiple=1
    )


Several = Annotated[list[_Item] | None, Parameter(consume_multiple=1)]
"""One value or more; the option may be repeated."""
File = Annotated[Path, Parameter(metavar="FILE")]
Folder = Annotated[Path, Parameter(metavar="DIR")]
Count = Annotated[int, Parameter(metavar="N", converter=_count)]
"""A number of things, from 1 on."""
Number = Annotated[int, Parameter(metavar="N")]
Hertz = Annotated[float, Parameter(metavar="HZ")]
Gigabytes = Annotated[float, Parameter(metavar="GB")]
Column = Annotated[str, Parameter(metavar="COLUMN")]
Name = Annotated[str, Parameter(metavar="NAME")]
Intervals = Annotated[
    list[tuple[float, float]] | None,
    Parameter(converter=_intervals, metavar="FROM:TO...", n_tokens=1, consume_multiple=1),
]
EFFECT, EFFECTS = Parameter(metavar="EFFECT"), Parameter(metavar="EFFECT...", consume_multiple=1)
"""An effect of the catalogue, or several: a shell completes their names."""
Effects = Annotated[list[str] | None, EFFECTS]
AsJson = Annotated[bool, Parameter(name="--json")]
Screen = Annotated[Terminal, Parameter(parse=False)]
"""No option: the program hands it over."""
