"""The catalogue of effects as lines of text for a terminal, and as JSON."""

import difflib
import textwrap
from typing import Any

from frictionjax.core import InputError, Parameter
from frictionjax.core.display import WIDTH
from frictionjax.physics import catalogue
from frictionjax.physics.effects import AbstractEffect


def effects_lines() -> list[str]:
    """Every effect that can be named, one a line, with what it is."""
    known = catalogue()
    width = max(len(name) for name in known)
    lines = [f"{name:<{width}}  {forms[0].about.sentence}" for name, forms in known.items()]
    return [*lines, "", "One in full: frictionjax effects NAME"]


def effect_lines(name: str) -> list[str]:
    """One effect in full.

    **Arguments:**

    - `name`: its name in the catalogue.

    **Returns:** lines of text.

    **Raises:** `InputError` for a name that is not in the catalogue.
    """
    forms = forms_of(name)
    about = forms[0].about
    facts = [
        ("What it is", about.sentence),
        ("Equation", about.equation),
        ("Shows in", about.shows),
        ("Recordings need", ", ".join(about.needs)),
        ("Confused with", ", ".join(about.confused_with)),
        ("To distinguish them", about.split_by),
        ("Source", about.source),
    ]
    lines = [name]
    for title, text in facts:
        if text:
            lines += textwrap.wrap(f"{title}: {text}", WIDTH, initial_indent="  ", subsequent_indent="    ")
    for form in forms:
        other = f" ({form.about.equation})" if form.about.equation != about.equation else ""
        lines += textwrap.wrap(
            f"Form {form.__name__}{other}", WIDTH, initial_indent="  ", subsequent_indent="    "
        )
        for parameter in (*form.strengths, *form.nuisances):
            lines.append(f"    {parameter.name} [{_unit(parameter)}]: {parameter.meaning}")
    return lines


def effect_json(name: str | None = None) -> dict[str, Any]:
    """The catalogue, or one effect of it, as plain JSON types.

    **Arguments:**

    - `name`: a name of the catalogue; None: all.

    **Returns:** name -> sentence, equation, shows, needs, confused_with, split_by, source, forms and their parameters.

    **Raises:** `InputError` for a name that is not in the catalogue.
    """
    chosen = catalogue() if name is None else {name: forms_of(name)}
    return {one: _json(forms) for one, forms in chosen.items()}


def _json(forms: tuple[type[AbstractEffect], ...]) -> dict[str, Any]:
    about = forms[0].about
    return {
        "sentence": about.sentence,
        "equation": about.equation,
        "shows": about.shows,
        "needs": list(about.needs),
        "confused_with": list(about.confused_with),
        "split_by": about.split_by,
        "source": about.source,
        "forms": {
            form.__name__: [
                {
                    "name": one.name,
                    "unit": _unit(one),
                    "meaning": one.meaning,
                    "strength": one in form.strengths,
                }
                for one in (*form.strengths, *form.nuisances)
            ]
            for form in forms
        },
    }


def forms_of(name: str) -> tuple[type[AbstractEffect], ...]:
    """The forms of an effect.

    **Arguments:**

    - `name`: its name in the catalogue.

    **Returns:** its classes.

    **Raises:** `InputError` for a name that is not in the catalogue, with the nearest one.
    """
    known = catalogue()
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"Did you mean `{near[0]}`? " if near else ""
        raise InputError(
            f"{name!r} is not an effect of the catalogue", cure=f"{hint}`frictionjax effects` lists them all"
        )
    return known[name]


def _unit(parameter: Parameter) -> str:
    """The unit with the words of the case for its quantities."""
    return parameter.unit.replace("{", "").replace("}", "")
