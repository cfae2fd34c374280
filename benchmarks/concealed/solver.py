"""Who solves: version, commit, source and thresholds, written down before the first case."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pkgutil
import platform
import subprocess
from importlib import import_module
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import frictionjax.diagnosis
import frictionjax.estimation
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.rule import Rule

FILE = "solver.json"
DECIDING = (frictionjax.diagnosis, frictionjax.estimation)
"""Packages whose numbers decide what is named."""


def thresholds(packages: tuple[ModuleType, ...] = DECIDING) -> dict[str, list]:
    """Every number of the rule and the effort, and every named one of the modules in `packages`, however it is nested:
    scalars, tuples, dictionaries, arrays.

    Numbers that stand in the code without a name are sealed by `source`.
    """
    found: dict[str, list] = {}
    for package in packages:
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            for name, value in vars(import_module(module.name)).items():
                numbers = list(_numbers(value)) if name.strip("_").isupper() else []
                if numbers:
                    found[f"{module.name.partition('.')[2]}.{name}"] = numbers
    for name, numbers in (("rule", Rule()), ("effort", Effort())):
        for group, own in dataclasses.asdict(numbers).items():
            for field, value in (own if isinstance(own, dict) else {"": own}).items():
                found[f"diagnosis.{name}.{group}.{field}".rstrip(".")] = list(_numbers([value]))
    return dict(sorted(found.items()))


def _numbers(value: Any):
    """The numbers in `value`, as JSON holds them."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, tuple | list):
        for one in value:
            yield from _numbers(one)
    elif type(value) in (int, float):
        yield value if isfinite(value) else str(value)


def source(package: ModuleType = frictionjax) -> str:
    """SHA-256 of the names and contents of all Python files of the `package`: numbers without a name included."""
    root, whole = Path(package.__path__[0]), hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        whole.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return whole.hexdigest()


def _git(*arguments: str) -> str:
    root = Path(__file__).parents[2]
    said = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
    return said.stdout.strip() if said.returncode == 0 else ""


def who_solves() -> dict:
    """Version, commit (and whether files differ from it), thresholds, source, and the machine."""
    return {
        "frictionjax": version("frictionjax"),
        "commit": _git("rev-parse", "HEAD") or "unknown",
        "changed_files": _git("status", "--porcelain", "--untracked-files=no", "frictionjax").splitlines(),
        "thresholds": thresholds(),
        "source": source(),
        "python": platform.python_version(),
        "jax": version("jax"),
        "cores": os.cpu_count(),
    }


def written_down(folder: Path, seal: dict) -> dict:
    """Write who solves what seal into `folder`, or check that it is who began.

    Raises `ValueError` when another version, commit, source or threshold began to solve there: one batch, one solver.
    """
    own, path = who_solves() | {"sealed": seal["sha256"]}, folder / FILE
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(own, indent=1) + "\n", encoding="utf-8")
        return own
    began = json.loads(path.read_text(encoding="utf-8"))
    differ = [
        key
        for key in ("frictionjax", "commit", "changed_files", "thresholds", "source", "sealed")
        if began.get(key) != own[key]
    ]
    if differ:
        raise ValueError(
            f"{path} says that another solver began here ({', '.join(differ)} differ); a batch is solved by one: check "
            "out that commit, or make a new batch with a fresh seed."
        )
    return began
