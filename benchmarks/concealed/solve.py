"""`solve`: the public `diagnose` on every case of a batch; the truth is neither needed nor looked for."""

from __future__ import annotations

import json
import math
import os
import sys
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import jax

import frictionjax as fj
from benchmarks.concealed.rivals import run_rivals
from benchmarks.concealed.seal import SEAL
from benchmarks.concealed.solver import written_down
from benchmarks.concealed.trace import trace_of
from frictionjax.core import FrictionjaxWarning, InputError, keep_compiled
from frictionjax.report.save import comparisons_json, verdict_json

SOLVED, VERDICT, RIVALS = "solved", "verdict.json", "rivals.json"
COMPILED = "compiled"
"""Folder beside the solved cases: programs of one shape are compiled once, as the program `frictionjax` does."""


def diagnosed(case_file: Path) -> dict:
    """verdict.json of a case, with a `trace` to draw, the evidence for each name and the comparisons; a case that is
    refused has the verdict "failed" and says why."""
    start = time.perf_counter()
    try:
        found = fj.diagnose(fj.load_case(case_file))
        evidence = [list(missing.evidence) for missing in found.missing]
        more = {"trace": trace_of(found), "evidence": evidence, "comparisons": comparisons_json(found)}
        verdict = verdict_json(found) | more
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


def _one(
    file: Path,
    folder: Path,
    rivals: bool,
    bic_seconds: float,
    diagnose: Callable[[Path], dict],
    rival: Callable[[Path, dict, float], dict],
) -> tuple[str, bool]:
    """What is missing in `folder` of the case in `file`: its verdict, and whether it was found now."""
    warnings.simplefilter("ignore", category=FrictionjaxWarning)
    fresh = not (folder / VERDICT).exists()
    if fresh:
        _keep(folder / VERDICT, diagnose(file))
        jax.clear_caches()  # programs are of the case's lengths: kept, they would fill the memory after some dozens
    verdict = json.loads((folder / VERDICT).read_text(encoding="utf-8"))
    if rivals and not (folder / RIVALS).exists():
        _keep(folder / RIVALS, rival(file, verdict, bic_seconds))
        jax.clear_caches()
    return verdict["verdict"], fresh


def solve(
    batch: Path,
    *,
    rivals: bool = False,
    bic_seconds: float = 0.0,
    diagnose: Callable[[Path], dict] = diagnosed,
    rival: Callable[[Path, dict, float], dict] = rivalled,
    executor: Executor | None = None,
    say: Callable[[str], object] = sys.stderr.write,
) -> int:
    """Solve what is not solved yet; returns how many cases were solved now.

    `rivals` lets the rivals look too, `bic_seconds` gives refits by BIC so long for each case; `diagnose` and `rival`
    are what is called with the file of a case (and its verdict). An `executor` solves several cases at once
    (`workers`); without one they are solved here, one after the other.
    """
    target = batch / SOLVED
    written_down(target, json.loads((batch / SEAL).read_text(encoding="utf-8")))
    files = sorted((batch / "cases").glob("*/case.toml"))
    began, fresh = time.perf_counter(), 0
    arguments = [(file, target / file.parent.name, rivals, bic_seconds, diagnose, rival) for file in files]
    if executor is None:
        ends = ((one[0], _one(*one)) for one in arguments)
    else:
        pending = {executor.submit(_one, *one): one[0] for one in arguments}
        ends = ((pending[done], done.result()) for done in as_completed(pending))
    for number, (file, (verdict, new)) in enumerate(ends, start=1):
        fresh += new
        say(f"{number} of {len(files)}, {time.perf_counter() - began:.0f} s: {file.parent.name} {verdict}\n")
    return fresh


def workers(count: int, batch: Path) -> Executor:
    """Processes that each solve a case of `batch` on a core of its own: one that is spread over two cores waits for
    itself."""
    context = get_context("spawn")
    cores = context.Queue()
    for core in shared_out(count):
        cores.put(core)
    return ProcessPoolExecutor(count, mp_context=context, initializer=_on_a_core, initargs=(cores, batch))


def shared_out(count: int) -> list[int]:
    """A core for each of `count` processes, of those that this one may use; where they are fewer, in turn."""
    own = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(count))
    return [own[number % len(own)] for number in range(count)]


def _on_a_core(cores, batch: Path) -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores.get()})
    set_up(batch)


def set_up(batch: Path) -> None:
    """Set JAX up as the program `frictionjax` does; what is compiled for `batch` is kept with it."""
    fj.configure_jax()
    keep_compiled(batch / SOLVED / COMPILED)
