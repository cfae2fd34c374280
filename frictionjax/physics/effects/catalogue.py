"""The catalogue: every effect in a file of this folder. A new effect takes one file and no change here."""

import importlib
import inspect
import pkgutil
from pathlib import Path

from frictionjax.physics.effects.base import AbstractEffect


def catalogue() -> dict[str, tuple[type[AbstractEffect], ...]]:
    """Name of each effect -> its forms (classes), in alphabetical order of the names.

    **Returns:**

    A dict; the forms of one name are the same effect in different equations (polynomial, periodic ...).
    """
    forms: dict[str, list[type[AbstractEffect]]] = {}
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        if module.name in ("base", "catalogue"):
            continue
        members = vars(importlib.import_module(f"{__package__}.{module.name}"))
        for member in members.values():
            if (
                inspect.isclass(member)
                and issubclass(member, AbstractEffect)
                and not inspect.isabstract(member)
            ):
                forms.setdefault(member.name, []).append(member)
    return {name: tuple(forms[name]) for name in sorted(forms)}
