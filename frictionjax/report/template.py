"""The templates of the page: filled in by Jinja, which escapes every text that is not marked as HTML."""

from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


def fill(template: str, **names: Any) -> Markup:
    """A template of `report/templates`, with the `names` that it uses, as HTML."""
    return Markup(_environment().get_template(template).render(**names))


def macro(name: str, *given: Any) -> Markup:
    """A piece of `templates/parts.html.j2` by its `name`, with the values `given` to it, as HTML."""
    return Markup(getattr(_parts(), name)(*given))


@cache
def _parts() -> Any:
    return _environment().get_template("parts.html.j2").module


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("frictionjax.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
