"""Diagnoses of simulated machines, one JSON line each: what was missing, what was found, and every number between.

    python -m benchmarks.bank --plan one --strengths strong medium --seeds 0 1 --out out/bank.jsonl

Lines that the file has already are not made again: an interrupted run goes on where it stopped.
"""

import argparse
import dataclasses
import functools
import importlib
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

import frictionjax as fj
from benchmarks.concealed.reality import CATALOGUE, OUTSIDE, make_case
from frictionjax.core import keep_compiled
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.select import Selection
from frictionjax.diagnosis.selection.step import Step
from frictionjax.diagnosis.table import ComparisonTable, OtherDecision, table_json
from frictionjax.recordings import Plant, Recording

pipeline = importlib.import_module("frictionjax.diagnosis.diagnose")
candidates = importlib.import_module("frictionjax.diagnosis.selection.refit_candidates")

COMPILED = "compiled"
"""Folder beside the lines: programs of one shape are compiled once, as the program `frictionjax` does."""
PAIRS = (
    ("creep", "direction_asymmetry"),
    ("maxwell_slip", "ripple"),
    ("constant_load", "quadratic_drag"),
    ("delay", "stribeck_shape"),
    ("position_dependence", "dwell_strengthening"),
    ("flexible_transmission", "constant_load"),
    ("encoder_error", "direction_asymmetry"),
    ("drive_lag", "return_spring"),
    ("nonlinear_bristle", "ripple"),
    ("friction_lag", "constant_load"),
)
"""Pairs of effects for the study of two at once."""


def jobs(plan: str, strengths: list[str], seeds: list[int], only: list[str]) -> Iterator[dict]:
    """What to diagnose: `one` effect, `none`, `pairs`, or `outside` the catalogue."""
    for seed in seeds:
        if plan == "none":
            yield {"seed": 1000 + seed, "missing": [], "strength": "strong"}
        for strength in strengths:
            names = only or {"outside": list(OUTSIDE)}.get(plan, list(CATALOGUE))
            if plan in ("one", "outside"):
                for number, name in enumerate(names):
                    offset = 2000 if plan == "one" else 4000
                    plant = offset + 100 * seed + number
                    yield {"seed": plant, "missing": [name], "strength": strength}
            if plan == "pairs":
                for number, pair in enumerate(PAIRS):
                    plant = 8000 + 100 * seed + number
                    yield {"seed": plant, "missing": list(pair), "strength": strength}


def case_of(simulated) -> fj.Case:
    """The simulated machine as a `Case` of the library."""
    recordings = tuple(
        Recording(
            name=r["name"],
            sample_rate=float(r["sample_rate"]),
            u=np.asarray(r["u"], float),
            x=np.asarray(r["x"], float),
            role=r["role"],
            loop=r["loop"],
            start_time=float(r["start_time"]),
        )
        for r in simulated.recordings
    )
    plant = simulated.plant
    known = {
        k: plant[k] for k in ("motor_constant", "position_unit", "force_unit", "input_unit", "encoder_step")
    }
    return fj.Case("bank", Plant(**known), recordings)


def round_in_numbers(step: Step) -> dict:
    """One round of the selection in plain numbers."""
    best: dict[str, list[float]] = {}
    for trial in step.trials:
        form = type(trial.form).__name__
        own = [float(trial.gain), float(trial.linear_gain), float(trial.p_value)]
        best[form] = max(best.get(form, [-9.0, 0.0, 1.0]), own)
    return {
        "force": step.force,
        "misfits": step.before.judgement.misfits(step.floor),
        "misfits_unit": step.before.judgement.misfits(np.ones((1, 1))),
        "gains": dict(sorted(best.items(), key=lambda kv: -kv[1][0])[:10]),
        "refits": [
            {
                "form": r.form,
                "effect": r.effect,
                "after": r.model.judgement.misfits(step.floor),
                "misfit": r.model.fitted.misfit,
                **{k: float(v) for k, v in dataclasses.asdict(row.gains(Rule())).items()},
            }
            for r, row in zip(step.refits, step.compared, strict=True)
        ],
        "accepted": step.accepted.form if step.accepted else None,
        "effect": step.accepted.effect if step.accepted else None,
        "rivals": list(step.rivals),
    }


def stored(tables: Sequence[ComparisonTable], decided: Sequence[OtherDecision] = ()) -> dict:
    """The `tables` of a selection as a line keeps them, with what else was `decided` and the rule that made them: for
    `benchmarks.replay`."""
    made_by = {"rule": dataclasses.asdict(Rule()), "rounds": Effort().rounds}
    others = [dataclasses.asdict(one) for one in decided]
    return made_by | {"tables": [table_json(table) for table in tables], "decided": others}


def diagnosed(job: dict, *, left_out: bool = False, own: bool = True) -> dict:
    """One line; with `left_out` also what is said, from the same base fit, when the catalogue lacks what is missing;
    not `own`: only that."""
    return diagnosis_and_line(job, left_out=left_out, own=own)[1]


def diagnosis_and_line(job: dict, *, left_out: bool = False, own: bool = True) -> tuple[fj.Diagnosis, dict]:
    """The diagnosis of a machine, and its line (see `diagnosed`)."""
    simulated = make_case(job["seed"], missing=tuple(job["missing"]), strength=job["strength"])
    kept: dict[str, Selection] = {}
    select, try_catalogue, true = pipeline.select, candidates.try_catalogue, frozenset(job["missing"])
    tested: dict[int, tuple[object, list]] = {}
    spent = [0.0]

    def tested_once(model, scales, executor, without, pair, *, effort):
        if id(model) not in tested:
            tested[id(model)] = (
                model,
                try_catalogue(model, scales, executor, without - true, pair, effort=effort),
            )
        return [[trial for trial in some if trial.effect not in without] for some in tested[id(model)][1]]

    def watched(*arguments, without=frozenset(), **options):
        if own:
            kept["own"] = select(*arguments, without=without, **options)
        if left_out:
            began = time.perf_counter()
            kept["left"] = select(*arguments, without=without | true, **options)
            spent.append(time.perf_counter() - began)
        return kept["own"] if own else kept["left"]

    pipeline.select, candidates.try_catalogue = watched, tested_once
    start = time.perf_counter()
    try:
        found = fj.diagnose(case_of(simulated))
    finally:
        pipeline.select, candidates.try_catalogue = select, try_catalogue
    left = None
    if left_out:
        left = {
            "verdict": kept["left"].decision.verdict,
            "steps": [round_in_numbers(step) for step in kept["left"].steps],
            "evidence": kept["left"].decision.evidence,
            "classes": kept["left"].decision.classes,
            "comparisons": stored(kept["left"].tables),
        }
    if not own:
        return found, job | {"left": left}
    return found, job | {
        "evidence": kept["own"].decision.evidence,
        "left": left,
        "verdict": found.verdict,
        "named": [m.effect for m in found.missing],
        "classes": [list(m.effect_class) for m in found.missing],
        "confidence": [m.confidence for m in found.missing],
        "parameters": [{k: [e.value, e.stderr] for k, e in m.parameters.items()} for m in found.missing],
        "sizes": simulated.truth["sizes"],
        "base": {k: e.value for k, e in found.base.items()},
        "truth": simulated.truth["base"],
        "steps": [round_in_numbers(step) for step in kept["own"].steps],
        "comparisons": stored(found.comparisons, found.decided),
        "held": {
            r.name: [r.prediction_rmse_base, r.prediction_rmse_extended, r.noise_floor]
            for r in found.recordings
            if r.role == "holdout"
        },
        "process_noise": simulated.truth["process_noise"],
        "seconds": time.perf_counter() - start - sum(spent),
        "stages": found.seconds,
        "compile": found.seconds["compile"],
    }


def plain(value):
    """`value` for JSON."""
    if isinstance(value, np.generic):
        return value.item()
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def job_of(line: dict) -> dict:
    """The job that made a `line`."""
    return {key: line[key] for key in ("seed", "missing", "strength")}


def can_change(evidence: list[list[float]], steps: list[dict]) -> bool:
    """Whether what was refused last may bring another name in (`Search.instead`): beside what was accepted, which
    does not explain nearly all. Shares are those above the last floor; the first effect's own share, above the floor
    of its round, is asked, too, so that rather too many lines count than too few."""
    return (
        bool(evidence)
        and steps[-1]["accepted"] is None
        and min(evidence[0][:2]) <= Rule().accept.enough_share
    )


def again(line: dict) -> dict | None:
    """The `line` with that side made anew, the effect in the catalogue or left out, that can change; None: neither."""
    left = line["left"]
    own = can_change(line["evidence"], line["steps"])
    left_out = bool(left) and can_change(left["evidence"], left["steps"])
    if not own and not left_out:
        return None
    found = diagnosed(job_of(line), left_out=left_out, own=own)
    return line | found | {"left": found["left"] if left_out else left}


def fill(
    path: Path,
    todo: Iterable[dict],
    diagnose: Callable[[dict], dict | None],
    *,
    part: tuple[int, int] = (0, 1),
    kept: Sequence[Path] = (),
) -> None:
    """`diagnose` the machines `todo` that are not yet in the file at `path`, nor in those `kept` from before; a line
    each, printed as they come. Of `part` (k, n) every n-th machine from the k-th on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [line for file in {path, *kept} if file.exists() for line in file.read_text().splitlines()]
    done = [job_of(json.loads(line)) for line in lines]
    mine = list(todo)[part[0] :: part[1]]
    for number, job in enumerate(mine, 1):
        if job_of(job) in done:
            continue
        line = diagnose(job)
        if line is None:
            continue
        jax.clear_caches()  # programs are of the machine's lengths: kept, they would fill the memory after two dozen
        with path.open("a") as file:
            file.write(json.dumps(line, default=plain) + "\n")
        sys.stderr.write(
            f"{number}/{len(mine)} {','.join(job['missing']) or 'nothing'} {job['strength']} {job['seed']}: "
            f"{line['verdict']} {','.join(line['named'])} {line['seconds']:.0f} s (compile {line['compile']:.0f})\n"
        )
        sys.stderr.flush()


def main() -> None:
    """Diagnose, and append to the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plan", choices=["one", "none", "pairs", "outside"], required=True)
    parser.add_argument("--strengths", nargs="+", default=["strong"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--left-out", action="store_true", help="diagnose also without what is missing")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    fj.configure_jax()
    keep_compiled(arguments.out.parent / COMPILED)
    fill(
        arguments.out,
        jobs(arguments.plan, arguments.strengths, arguments.seeds, arguments.only),
        functools.partial(diagnosed, left_out=arguments.left_out),
    )


if __name__ == "__main__":
    main()
