"""The doors of the package and what they offer, and the files of the project."""

import importlib
import inspect
import pkgutil
import subprocess
from pathlib import Path
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


def tracked_files(repository: Path) -> list[Path]:
    """The files under version control; in an unpacked archive, every file that does not hide or get generated."""
    listing = subprocess.run(["git", "-C", repository, "ls-files", "-z"], capture_output=True, text=True)
    if listing.returncode == 0 and listing.stdout:
        return [path for name in listing.stdout.split("\0") if name and (path := repository / name).is_file()]
    folders = [repository / name for name in ("frictionjax", "tests", "benchmarks", "docs", "notebooks")]
    inside = [path for folder in folders for path in folder.rglob("*") if "__pycache__" not in path.parts]
    return [path for path in [*repository.iterdir(), *inside] if path.is_file()]
