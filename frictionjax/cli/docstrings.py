"""The docstring of a command, read for its help: what it does, what each option means, and examples."""

import functools
import inspect
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

from cyclopts import Parameter

from frictionjax.cli.kinds import EFFECT, EFFECTS

_Thing = TypeVar("_Thing")


class Guide(NamedTuple):
    """What a docstring says: `about` the whole, the meaning of each argument or field in `meanings`, and `examples`."""

    about: str
    meanings: dict[str, str]
    examples: str


def guide(thing: Any) -> Guide:
    """What the docstring of a `thing`, a command or a class of options, says."""
    text = inspect.getdoc(thing) or ""
    about, _, examples = text.partition("**Examples:**")
    about, *items = re.split(r"^- `(\w+)`: ", about, flags=re.MULTILINE)
    meanings = {name: " ".join(said.split()) for name, said in zip(items[::2], items[1::2], strict=True)}
    about = about.replace("**Arguments:**", "")
    paragraphs = (" ".join(one.split()) for one in about.strip().split("\n\n"))
    listed = textwrap.indent(textwrap.dedent(examples).strip("\n"), "  ")
    return Guide("\n\n".join(paragraphs), meanings, f"examples:\n{listed}" if listed else "")


def options(kind: type[_Thing]) -> type[_Thing]:
    """Options that several commands share: the fields of a class, this `kind`, with its docstring as their help."""
    kind.__annotations__ = _explained(kind, ())
    return kind


def command(function: Callable[..., None], effects: Sequence[str] = ()) -> Callable[..., None]:
    """A function as cyclopts reads it.

    **Arguments:**

    - `function`: its arguments are the options, its docstring is their help
    - `effects`: names that may stand where an effect is asked for; empty: any, and the command itself judges them
    """

    @functools.wraps(function)
    def called(*given: Any, **named: Any) -> None:
        function(*given, **named)

    called.__annotations__ = _explained(function, effects)
    return called


def _explained(thing: Any, effects: Sequence[str]) -> dict[str, Any]:
    """The annotations of a `thing` with the help of its docstring."""
    found, meanings = dict(thing.__annotations__), guide(thing).meanings
    for name, meaning in meanings.items():
        marked = any(one in (EFFECT, EFFECTS) for one in getattr(found[name], "__metadata__", ()))
        choices = tuple(effects) if marked and effects else None
        found[name] = Annotated[found[name], Parameter(help=meaning, choices=choices)]
    return found
