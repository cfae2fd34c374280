"""The blind challenge: what is drawn, how it is sealed, and that nobody who solves can have seen the truth."""

import ast
import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("numba")

from helpers_challenge import plain_batch, verdict

from benchmarks.concealed import make as making
from benchmarks.concealed import solver
from benchmarks.concealed.composition import (
    CONFUSABLE,
    NAMED,
    SHARES,
    TWO,
    compose,
    counts,
    shows_in,
)
from benchmarks.concealed.reality import EFFECTS
from benchmarks.concealed.reveal import answers_of
from benchmarks.concealed.seal import BrokenSeal, open_seal
from benchmarks.concealed.solve import shared_out, solve
from frictionjax.diagnosis import Rule
from frictionjax.physics.effects import catalogue

ROOT = Path(__file__).parents[2]
CHALLENGE = ROOT / "benchmarks" / "concealed"


def imports(path):
    """(module, imported name) of every import of a file, wherever it stands."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)


def test_a_batch_has_the_stated_shares():
    assert counts(120) == {"nothing": 30, "one": 54, "two": 12, "confusable": 6, "outside": 18}
    assert sum(counts(7).values()) == 7
    plans = compose(120, 7)
    assert Counter(plan.stratum for plan in plans) == counts(120)
    strengths = Counter(plan.strength for plan in plans if plan.stratum == "one")
    assert strengths == {"strong": 18, "medium": 18, "weak": 18}
    assert {plan.missing[0] for plan in plans if plan.stratum == "one"} == set(NAMED)
    assert len({plan.missing[0] for plan in plans if plan.stratum == "outside"}) >= 8
    assert compose(120, 7) == plans != compose(120, 8)
    assert [plan.stratum for plan in plans] != sorted(plan.stratum for plan in plans)
    assert len({plan.rate for plan in plans}) == 5
    assert len({plan.families for plan in plans}) == 7


def test_names_of_the_challenge_are_known_on_both_sides():
    assert set(NAMED) == set(catalogue())
    for pair in (*CONFUSABLE, *TWO):
        assert len(set(pair)) == 2
        assert set(pair) <= set(NAMED) <= set(EFFECTS)


def test_what_hides_shows_in_its_experiments():
    for plan in compose(120, 9):
        assert all(shows_in(effect, plan.families) for effect in plan.missing)


def test_conditions_say_nothing_of_what_is_concealed():
    """Every stratum is dealt the same conditions: shares within the rounding of a deal from those of the whole."""
    plans = compose(1200, 3)
    for of in (lambda p: p.coloured, lambda p: p.rate, lambda p: p.families == "odd"):
        whole = Counter(of(plan) for plan in plans)
        for stratum in SHARES:
            own = [of(plan) for plan in plans if plan.stratum == stratum]
            for value, number in whole.items():
                assert abs(own.count(value) - len(own) * number / len(plans)) < 2.0, (stratum, value)


def test_names_and_files_give_nothing_away(tmp_path, monkeypatch):
    keys = ("sizes", "base", "process_noise", "sensor_noise", "kind")

    def unsimulated(plan, horizon=0.0):
        t = np.arange(5) / plan["rate"]
        recording = {
            "name": "moves",
            "role": "fit",
            "loop": "closed",
            "start_time": 0.0,
            "t": t,
            "u": t,
            "x": t,
        }
        return SimpleNamespace(
            plant={"motor_constant": 2.0}, recordings=[recording], truth=dict.fromkeys(keys), given={}
        )

    monkeypatch.setattr(making, "simulated", unsimulated)
    value = making.make(4, 5, tmp_path / "batch")
    folders = sorted(path.name for path in (tmp_path / "batch" / "cases").iterdir())
    assert folders == ["case_001", "case_002", "case_003", "case_004"]
    public = [p for p in (tmp_path / "batch").rglob("*") if p.is_file() and "sealed" not in p.parts]
    text = "".join(p.name + p.read_text() for p in public if p.suffix != ".csv")
    secrets = [*EFFECTS, *SHARES, "missing", "strength", *(str(plan.seed) for plan in compose(4, 5))]
    assert not [word for word in secrets if word in text]
    own = open_seal(tmp_path / "batch")
    assert json.loads((tmp_path / "batch" / "seal.json").read_text())["sha256"] == value
    assert [own["cases"][name]["seed"] for name in folders] == [plan.seed for plan in compose(4, 5)]
    with pytest.raises(FileExistsError, match="not empty"):
        making.make(4, 5, tmp_path / "batch")


def test_a_changed_truth_or_case_is_refused(tmp_path):
    batch = plain_batch(tmp_path / "batch")
    assert set(open_seal(batch)["cases"]) == {"case_001", "case_002", "case_003"}
    (batch / "cases" / "case_002" / "case.toml").write_text("other")
    with pytest.raises(BrokenSeal, match="case_002"):
        open_seal(batch)
    other = plain_batch(tmp_path / "other")
    path = other / "sealed" / "truth.json"
    path.write_bytes(path.read_bytes().replace(b'"nothing"', b'"outside"', 1))
    with pytest.raises(BrokenSeal, match="changed after it was sealed"):
        answers_of(other, look=False)
    path.unlink()
    with pytest.raises(BrokenSeal, match="missing"):
        open_seal(other)


def test_the_same_truth_never_has_the_same_hash(tmp_path):
    """Without a nonce, who guesses the truth could check the guess against the public hash."""
    seals = [(plain_batch(tmp_path / name) / "seal.json").read_text() for name in "ab"]
    assert seals[0] != seals[1]


def test_solving_needs_no_truth_and_goes_on_where_it_stopped(tmp_path):
    batch, seen, said = plain_batch(tmp_path / "batch"), [], []
    shutil.rmtree(batch / "sealed")

    def diagnose(file):
        seen.append(file.parent.name)
        if seen == ["case_001", "case_002"]:
            raise KeyboardInterrupt
        return verdict()

    def rival(file, own, seconds):
        return {"largest_r2": {"named": None, "seconds": seconds}}

    with pytest.raises(KeyboardInterrupt):
        solve(batch, diagnose=diagnose, say=said.append)
    assert solve(batch, diagnose=diagnose, say=said.append) == 2
    assert seen == ["case_001", "case_002", "case_002", "case_003"]
    assert said[-1].startswith("3 of 3")
    assert solve(batch, diagnose=diagnose, rivals=True, bic_seconds=2.0, rival=rival, say=said.append) == 0
    assert (
        json.loads((batch / "solved" / "case_003" / "rivals.json").read_text())["largest_r2"]["seconds"]
        == 2.0
    )
    began = json.loads((batch / "solved" / "solver.json").read_text())
    assert began["thresholds"]["diagnosis.rule.accept.lead"] == [Rule().accept.lead]
    assert began["sealed"] == json.loads((batch / "seal.json").read_text())["sha256"]


def test_an_executor_solves_several_at_once(tmp_path):
    batch, said = plain_batch(tmp_path / "batch"), []
    together = Barrier(3, timeout=600.0)

    def diagnose(file):
        together.wait()
        return verdict()

    with ThreadPoolExecutor(3) as executor:
        assert solve(batch, diagnose=diagnose, executor=executor, say=said.append) == 3
        assert solve(batch, diagnose=diagnose, executor=executor, say=said.append) == 0
    assert [text.split(",")[0] for text in said[:3]] == ["1 of 3", "2 of 3", "3 of 3"]


def test_the_seal_holds_every_number(tmp_path, monkeypatch):
    """Arrays, nested tuples, the packages below, and, by a hash, what has no name at all."""
    sealed = solver.thresholds()
    assert {name.split(".")[0] for name in sealed} == {"diagnosis", "estimation"}
    assert len(sealed["diagnosis.mismatch_map.frequency_bands._EDGES"]) == 9
    assert sealed["diagnosis.effort.backlash.turns"] == [10.0, 0.5, 10.0, 0.25, 1.0, 0.1]
    assert sealed["diagnosis.rule.limits.adequate"] == [0.01]
    package = tmp_path / "machine"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "law.py").write_text("def f(x):\n    return 0.5 * x\n")
    root = SimpleNamespace(__path__=[str(package)])
    before = solver.source(root)
    (package / "law.py").write_text("def f(x):\n    return 0.4 * x\n")
    assert solver.source(root) != before


def test_one_batch_has_one_solver(tmp_path, monkeypatch):
    batch = plain_batch(tmp_path / "batch", cases=1)
    solve(batch, diagnose=lambda file: verdict(), say=lambda text: None)
    own = solver.who_solves()
    other = own | {"thresholds": own["thresholds"] | {"diagnosis.rule.accept.least_share": [0.1]}}
    monkeypatch.setattr(solver, "who_solves", lambda: other)
    with pytest.raises(ValueError, match="thresholds differ"):
        solve(batch, diagnose=lambda file: verdict(), say=lambda text: None)


def test_who_makes_knows_no_library_and_who_solves_no_truth():
    for name in ("__init__", "composition", "seal", "make"):
        roots = {module.split(".")[0] for module, _ in imports(CHALLENGE / f"{name}.py")}
        assert not roots & {"frictionjax", "jax", "equinox"}, name
    for path in (CHALLENGE / "solve.py", CHALLENGE / "solver.py", *(CHALLENGE / "rivals").glob("*.py")):
        for module, name in imports(path):
            inside = module.removeprefix("benchmarks.concealed.").split(".")[0]
            assert inside not in ("reality", "make", "composition", "answers", "witness", "reveal"), path
            assert inside != "seal" or name == "SEAL", path


def test_every_worker_gets_a_core_also_where_they_are_fewer(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5, 3}, raising=False)
    assert shared_out(1) == [3]
    assert shared_out(5) == [3, 5, 3, 5, 3]


@pytest.mark.slow
def test_a_batch_of_twelve_is_made_solved_and_revealed(tmp_path):
    def run(*arguments):
        command = [sys.executable, "-m", "benchmarks.concealed", *map(str, arguments)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-3000:]
        return done.stdout

    assert "sha256" in run("make", "--cases", 12, "--seed", 612, "--out", tmp_path / "batch")
    (tmp_path / "batch" / "sealed").rename(tmp_path / "away")
    run("solve", tmp_path / "batch", "--rivals", "--bic-seconds", 5, "--workers", 2)
    (tmp_path / "away").rename(tmp_path / "batch" / "sealed")
    told = run("reveal", tmp_path / "batch", "--out", tmp_path / "out")
    assert "measured on 12 cases" in told
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["scores"]["failed"] == 0
    assert set(results["scores"]["rivals"]) == {"largest_r2", "sparse", "bic"}
    # A coin would name one effect of 28: ten cases with something hidden hold at least one right name.
    assert sum(case["outcome"] in ("named", "class") for case in results["cases"].values()) >= 1
    assert (tmp_path / "out" / "report.html").read_text().count("<img") >= 5
