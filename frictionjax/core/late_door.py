"""Doors of packages that load what stands behind a public name when that is first asked for.

`frictionjax check` needs one file of the diagnosis: without this, its package would load every other one as well.
"""

import importlib
import sys
from types import ModuleType
from typing import Any


class _LateDoor(ModuleType):
    """The module of a package whose public names are loaded late."""

    def __getattr__(self, name: str) -> Any:
        behind = self.__dict__["_behind"]
        if name not in behind:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        found = getattr(importlib.import_module(f"{self.__name__}.{behind[name]}"), name)
        self.__dict__[name] = found
        return found

    def __setattr__(self, name: str, value: Any) -> None:
        # Python binds a module here when it is imported; a public name of the same spelling stays what it is.
        if not (isinstance(value, ModuleType) and name in self.__dict__["_behind"]):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self.__dict__["_behind"]})


def late_door(package: str, behind: dict[str, str]) -> None:
    """Make the module of a `package` load its public names late.

    **Arguments:**

    - `package`: its dotted name, `__name__` in its door.
    - `behind`: public name -> the module under the package that defines it. The door imports the same names for type
        checkers.
    """
    module = sys.modules[package]
    module.__dict__["_behind"] = behind
    module.__class__ = _LateDoor
