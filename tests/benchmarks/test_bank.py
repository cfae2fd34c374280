"""The bank's lines: kept thin without a change of the tables, and never diagnosed twice."""

import json
from pathlib import Path

import pytest

pytest.importorskip("numba")

from benchmarks import bank, calibrate, diagnosis

BANK = ["bank", "bank_31", "bank_32", "bank_33", "bank_34"]


def _line(seed, missing, named, **more):
    def step(effect):
        return {
            "misfits_unit": [0.4, 0.3],
            "accepted": effect and f"{effect}_form",
            "effect": effect,
            "gains": {"Form": [1.0, 2.0, 3.0]},
            "refits": [{"form": "Form"}],
        }

    return {
        "seed": seed,
        "missing": missing,
        "strength": "strong",
        "verdict": "named" if named else "adequate",
        "named": named,
        "classes": [[name] for name in named],
        "parameters": [{"load": [1.02, 0.01]} for _ in named],
        "sizes": {"constant_load": {"force": 1.0}},
        "held": {"moves": [5.0, 1.1, 1.0]},
        "seconds": 60.0,
        "steps": [step(name) for name in (*named, None)],
        "evidence": [[0.9, 0.9, 0.2, 0.99] for _ in named],
        "left": None,
        **more,
    }


def _told(monkeypatch, capsys, *arguments):
    monkeypatch.setattr("sys.argv", ["diagnosis", "--tables", *map(str, arguments)])
    diagnosis.main()
    return capsys.readouterr().out


def test_what_is_stored_prints_the_same_tables(tmp_path, monkeypatch, capsys):
    right = _line(1, ["constant_load"], ["constant_load"])
    away = {key: right[key] for key in ("verdict", "steps", "evidence")}
    wrong = _line(2, ["creep"], ["ripple"], left=away | {"evidence": [[0.95, 0.9, 0.2, 0.99]]})
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "one-1-of-2.jsonl").write_text(json.dumps(right) + "\n")
    (tmp_path / "out" / "one-2-of-2.jsonl").write_text(json.dumps(wrong) + "\n")
    (tmp_path / "out" / "none-1-of-2.jsonl").write_text(json.dumps(_line(3, [], [])) + "\n")
    kept = tmp_path / "kept"
    full = _told(monkeypatch, capsys, "--out", tmp_path / "out", "--store", kept)
    assert "strong: right within class 1 of 2, named wrongly 1." in full
    assert "left out of the catalogue, 1: named 1; named: creep (strong) as constant_load. Of" in full
    assert "Of another class than what was left out: 1 of 1." in full
    assert "nothing missing, 1: adequate 1." in full
    assert "median error 2.00 %" in full
    assert sorted(path.name for path in kept.iterdir()) == ["none.jsonl", "one.jsonl"]
    assert "gains" not in (kept / "one.jsonl").read_text()
    assert _told(monkeypatch, capsys, "--out", kept) == full
    names = calibrate.read([kept / "one.jsonl"])
    assert names.features.shape == (3, 4) and names.right.tolist() == [True, False, False]
    assert names.weight.tolist() == [1.0, 1.0, 1.0]
    assert names.what == [
        "constant_load as constant_load",
        "creep as ripple",
        "left out: creep as constant_load",
    ]


@pytest.mark.parametrize(
    ("effect", "explained", "verdict"),
    [("constant_load", 0.85, "unknown"), ("constant_load", 0.95, "named"), ("creep", 0.85, "named")],
)
def test_without_the_true_effect_the_limits_of_today_decide(effect, explained, verdict):
    """Whatever the version said that made the line."""
    line = _line(4, ["delay"], [effect])
    left = {"verdict": "named", "steps": line["steps"], "evidence": [[explained, 0.8, 0.2, 0.99]]}
    assert diagnosis.verdict_without(line | {"left": left}) == verdict
    nothing = {"verdict": "adequate", "steps": line["steps"][-1:], "evidence": []}
    assert diagnosis.verdict_without(line | {"left": nothing}) == "adequate"


def test_no_machine_is_diagnosed_twice(tmp_path):
    asked = []

    def diagnosed(job):
        asked.append(job["seed"])
        return _line(job["seed"], job["missing"], []) | {"compile": 0.0}

    todo = list(bank.jobs("none", ["strong"], [30, 31, 32, 33], []))
    kept = tmp_path / "none.jsonl"
    kept.write_text(json.dumps(_line(1030, [], [])) + "\n")
    for _ in range(2):
        bank.fill(tmp_path / "none-1-of-2.jsonl", todo, diagnosed, part=(0, 2), kept=[kept])
    assert asked == [1032]
    bank.fill(tmp_path / "none-2-of-2.jsonl", todo, diagnosed, part=(1, 2))
    assert asked == [1032, 1031, 1033]


def test_only_what_a_refused_effect_may_change_is_made_anew(monkeypatch):
    asked = []

    def diagnosed(job, *, left_out, own):
        asked.append((job["seed"], left_out, own))
        left = {"verdict": "named", "steps": [], "evidence": []} if left_out else None
        return job | ({"verdict": "unknown", "left": left} if own else {"left": left})

    monkeypatch.setattr(bank, "diagnosed", diagnosed)
    little, much = [[0.7, 0.9, 0.2, 0.99]], [[0.85, 0.9, 0.2, 0.99]]
    sure = _line(1, ["creep"], ["creep"], evidence=much)
    left = {key: sure[key] for key in ("verdict", "steps")}
    assert bank.again(sure) is None
    assert bank.again(sure | {"left": left | {"evidence": much}}) is None
    half = sure | {"evidence": little, "left": left | {"evidence": much}}
    assert bank.again(half) == half | {"verdict": "unknown"}
    away = bank.again(sure | {"left": left | {"evidence": little}})
    assert away == sure | {"left": {"verdict": "named", "steps": [], "evidence": []}}
    assert asked == [(1, False, True), (1, True, False)]
    # The last round accepted something: nothing was refused beside it.
    assert bank.again(half | {"steps": half["steps"][:1]}) is None
    said, other = [], half | {"seed": 2, "left": left | {"evidence": little}}
    diagnosis.print_changes([half, other, sure], [half], said.append)
    assert said == [
        "- can change, the effect in the catalogue: 2 of 3; made anew: 1.",
        "- can change, the effect left out: 1 of 2; made anew: 0.",
    ]


def test_of_a_machine_reported_twice_the_first_folder_counts(tmp_path, monkeypatch, capsys):
    for folder, named in (("old", []), ("new", ["creep"])):
        (tmp_path / folder).mkdir()
        line = _line(1, ["creep"], named)
        (tmp_path / folder / "one.jsonl").write_text(json.dumps(line) + "\n")
    told = _told(monkeypatch, capsys, "--out", tmp_path / "new", "--beside", tmp_path / "old")
    assert "strong: right within class 1 of 1, named wrongly 0." in told
    told = _told(monkeypatch, capsys, "--out", tmp_path / "old", "--beside", tmp_path / "new")
    assert "strong: right within class 0 of 1, named wrongly 0." in told


def test_names_of_a_revealed_batch_are_calibrated_on_too(tmp_path):
    path = tmp_path / "7.json"
    cases = {
        "case_1": {"missing": ["creep"], "named": ["creep"], "evidence": [[0.9, 0.8, 0.1, 0.99]]},
        "case_2": {"missing": [], "named": ["ripple"], "evidence": [[0.5, 0.5, 0.1, 0.6]]},
        "case_3": {"missing": ["delay"], "named": [], "evidence": []},
    }
    path.write_text(json.dumps({"cases": cases}))
    names = calibrate.read([path])
    assert names.features.shape == (2, 4)
    assert names.right.tolist() == [True, False]
    assert names.what == ["creep as creep", "nothing as ripple"]


def test_physics_outside_the_catalogue_is_weighed_as_often_as_it_is_met(tmp_path):
    one, outside = _line(1, ["creep"], ["creep"]), _line(2, ["outside:fade"], ["ripple"])
    (tmp_path / "one.jsonl").write_text(json.dumps(one | {"left": None}) + "\n")
    (tmp_path / "outside.jsonl").write_text(2 * (json.dumps(outside) + "\n"))
    names = calibrate.read([tmp_path / "one.jsonl", tmp_path / "outside.jsonl"], outside=0.2)
    # One machine with a name to find, two of the others: these count half of a quarter each.
    assert names.right.tolist() == [True, False, False]
    assert names.weight.tolist() == pytest.approx([1.0, 0.125, 0.125])


SUMS = {
    **{name: [name] for name in BANK},
    "all": BANK,
    "again": ["bank_again", "pairs_again", *BANK],
}


@pytest.mark.parametrize("name", SUMS)
def test_the_sums_in_the_page_of_the_bank_are_those_of_the_lines_that_are_kept(name, monkeypatch, capsys):
    benchmarks = Path(diagnosis.__file__).parent
    first, *beside = SUMS[name]
    results = benchmarks / "results"
    more = ["--beside", *(results / folder for folder in beside)] if beside else []
    sums = _told(monkeypatch, capsys, "--out", results / first, *more).partition("### in all\n")[2]
    text = (benchmarks.parent / "docs" / "benchmarks" / "bank.md").read_text(encoding="utf-8")
    assert sums.strip() == text.partition(f"<!-- sums of {name} -->")[2].partition("<!-- end -->")[0].strip()
