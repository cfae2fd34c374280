"""Who solves: version, commit and thresholds, written down before the first case."""

from __future__ import annotations

import json
import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

from frictionjax.diagnosis import select

FILE = "solver.json"


def thresholds() -> dict[str, float]:
    """Every number by which the selection decides, by its name in `frictionjax.diagnosis.select`."""
    return {
        name: value
        for name, value in sorted(vars(select).items())
        if isinstance(value, int | float) and not isinstance(value, bool) and name.strip("_").isupper()
    }


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
