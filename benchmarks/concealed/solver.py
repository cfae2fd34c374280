"""Who solves: version, commit and thresholds, written down before the first case."""

from __future__ import annotations

import json
import os
import pkgutil
import platform
import subprocess
from importlib import import_module
from importlib.metadata import version
from math import isfinite
from pathlib import Path

import frictionjax.diagnosis

FILE = "solver.json"


def thresholds() -> dict[str, list[float | str]]:
    """Every number by which the diagnosis decides: the constants of the modules of `frictionjax.diagnosis`."""
    found: dict[str, list[float | str]] = {}
    for module in pkgutil.iter_modules(frictionjax.diagnosis.__path__):
        for name, value in vars(import_module(f"frictionjax.diagnosis.{module.name}")).items():
            numbers = value if isinstance(value, tuple) else (value,)
            if name.strip("_").isupper() and numbers and all(type(one) in (int, float) for one in numbers):
                found[f"{module.name}.{name}"] = [one if isfinite(one) else str(one) for one in numbers]
    return dict(sorted(found.items()))


def _git(*arguments: str) -> str:
    root = Path(__file__).parents[2]
    said = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
    return said.stdout.strip() if said.returncode == 0 else ""


def who_solves() -> dict:
    """Version, commit (and whether files differ from it), thresholds, and the machine."""
    return {
        "frictionjax": version("frictionjax"),
        "commit": _git("rev-parse", "HEAD") or "unknown",
        "changed_files": _git("status", "--porcelain", "--untracked-files=no", "frictionjax").splitlines(),
        "thresholds": thresholds(),
        "python": platform.python_version(),
        "jax": version("jax"),
        "cores": os.cpu_count(),
    }


def written_down(folder: Path, seal: dict) -> dict:
    """Write who solves what seal into `folder`, or check that it is who began.

    Raises `ValueError` when another version, commit or threshold began to solve there: one batch, one solver.
    """
    own, path = who_solves() | {"sealed": seal["sha256"]}, folder / FILE
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(own, indent=1) + "\n", encoding="utf-8")
        return own
    began = json.loads(path.read_text(encoding="utf-8"))
    differ = [
        key
        for key in ("frictionjax", "commit", "changed_files", "thresholds", "sealed")
        if began[key] != own[key]
    ]
    if differ:
        raise ValueError(
            f"{path} says that another solver began here ({', '.join(differ)} differ); a batch is solved by one: check "
            "out that commit, or make a new batch with a fresh seed."
        )
    return began
