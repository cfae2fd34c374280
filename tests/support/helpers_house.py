"""The doors of the package, and what they offer."""

import importlib
import inspect
import pkgutil
from typing import Any

import frictionjax

DOORS = ["frictionjax.api"] + [
    module.name for module in pkgutil.walk_packages(frictionjax.__path__, "frictionjax.") if module.ispkg
]


def public_names(door: str) -> list[str]:
    """The names that a package offers: its `__all__`, else all that it binds without an underscore."""
    module = importlib.import_module(door)
    below = [name for name, value in vars(module).items() if inspect.ismodule(value)]
    own = [name for name in below if getattr(module, name).__name__ == f"{door}.{name}"]
    return getattr(module, "__all__", [n for n in vars(module) if not n.startswith("_") and n not in own])


def home_of(value: Any) -> str:
    """The top package that a module, class or function comes from; ours for plain values."""
    if inspect.ismodule(value):
        return value.__name__.split(".")[0]
    if inspect.isclass(value) or inspect.isroutine(value):
        return value.__module__.split(".")[0]
    return "frictionjax"
