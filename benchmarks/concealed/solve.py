"""`solve`: the public `diagnose` on every case of a batch; the truth is neither needed nor looked for."""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import frictionjax as fj
from benchmarks.concealed.rivals import run_rivals
from benchmarks.concealed.seal import SEAL
from benchmarks.concealed.solver import written_down
from benchmarks.concealed.trace import trace_of
from frictionjax.core import FrictionjaxWarning, InputError
from frictionjax.diagnosis.output import verdict_json

SOLVED, VERDICT, RIVALS = "solved", "verdict.json", "rivals.json"


def diagnosed(case_file: Path) -> dict:
    """verdict.json of a case, with a `trace` to draw; a case that is refused has the verdict "failed" and says why."""
    start = time.perf_counter()
    try:
        found = fj.diagnose(fj.load_case(case_file))
        verdict = verdict_json(found) | {"trace": trace_of(found)}
    except (InputError, ValueError, FloatingPointError) as error:
        verdict = {"verdict": "failed", "error": str(error), "missing": [], "seconds": {}}
    verdict["seconds"]["wall"] = round(time.perf_counter() - start, 2)
    return verdict


def rivalled(case_file: Path, verdict: dict, bic_seconds: float) -> dict:
    """What the rivals say of a case, from the base model that the `verdict` found."""
    if verdict["verdict"] == "failed":
        return {"failed": verdict["error"]}
    return run_rivals(fj.load_case(case_file), verdict, bic_seconds)


def strict(value):
    """`value` for strict JSON: what is not finite becomes None, all the way down."""
    if isinstance(value, dict):
        return {key: strict(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [strict(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _keep(path: Path, content: dict) -> None:
    """Write JSON whole or not at all, so that an interrupted run leaves nothing that looks done."""
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_suffix(".new")
    fresh.write_text(json.dumps(strict(content), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    fresh.replace(path)


def solve(
    batch: Path,
    *,
    rivals: bool = False,
    bic_seconds: float = 0.0,
    diagnose: Callable[[Path], dict] = diagnosed,
    rival: Callable[[Path, dict, float], dict] = rivalled,
    say: Callable[[str], object] = sys.stderr.write,
) -> int:
    """Solve what is not solved yet; returns how many cases were solved now.

    `rivals` lets the rivals look too, `bic_seconds` gives refits by BIC so long for each case; `diagnose` and `rival`
    are what is called with the file of a case (and its verdict).
    """
    warnings.simplefilter("ignore", category=FrictionjaxWarning)
    target = batch / SOLVED
    written_down(target, json.loads((batch / SEAL).read_text(encoding="utf-8")))
    files = sorted((batch / "cases").glob("*/case.toml"))
    fresh, begun = 0, time.perf_counter()
    for number, file in enumerate(files, start=1):
        folder = target / file.parent.name
        if not (folder / VERDICT).exists():
            _keep(folder / VERDICT, diagnose(file))
            fresh += 1
        verdict = json.loads((folder / VERDICT).read_text(encoding="utf-8"))
        if rivals and not (folder / RIVALS).exists():
            _keep(folder / RIVALS, rival(file, verdict, bic_seconds))
        spent = time.perf_counter() - begun
        say(f"{number} of {len(files)}, {spent:.0f} s: {file.parent.name} {verdict['verdict']}\n")
    return fresh
