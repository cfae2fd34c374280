"""Another rule on stored lines: what it says, and that the rule of today says what the lines do."""

import dataclasses
import gzip
import json

import pytest
from helpers_rule import row, table

pytest.importorskip("numba")

from benchmarks import diagnosis, replay
from frictionjax.diagnosis.evidence.input_needed import INPUT
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import OtherDecision, table_json


def _stored(*tables, decided=()):
    own = [table_json(one) for one in tables]
    others = [dataclasses.asdict(one) for one in decided]
    return {"rule": dataclasses.asdict(Rule()), "rounds": 3, "tables": own, "decided": others}


def _line(seed, missing, names, verdict="named", *, comparisons=None, left=None):
    said = {"verdict": verdict, "named": names, "classes": [[name] for name in names]}
    steps = [{"misfits_unit": [0.4, 0.3], "accepted": "F", "effect": name} for name in names]
    more = {"steps": steps, "evidence": [], "left": left} | (
        {"comparisons": comparisons} if comparisons else {}
    )
    return {"seed": seed, "missing": missing, "strength": "strong"} | said | more


@pytest.fixture
def lines():
    """A right name, another name where that is left out, an adequate machine, and a line without tables."""
    delay = table(row((0.99, 0.99), effect="delay", exact=(True,)))
    creep = table(row((0.93, 0.93), effect="creep", before=(0.1, 0.1)), misfits=(0.1, 0.1))
    away = _line(1, ["delay"], ["creep"], comparisons=_stored(creep))
    return [
        _line(1, ["delay"], ["delay"], comparisons=_stored(delay), left=away),
        _line(2, [], [], "adequate", comparisons=_stored(table(misfits=(0.004, 0.004)))),
        _line(3, ["creep"], ["creep"]),
    ]


def test_the_rule_of_today_says_what_the_lines_do(lines):
    found = replay.score(lines, Rule())
    assert (found.alike, found.compared, found.others) == (3, 3, [])
    assert found.counts["one effect"] == {"right": 1, "no table": 1}
    assert found.counts["left out"] == {"other name": 1}
    assert found.counts["nothing missing"] == {"adequate": 1}


def test_every_line_that_is_kept_names_its_machine():
    paths = replay.stored_lines()
    assert {path.parent.name for path in paths} > {"bank", "bank_agreement"}
    kept = replay.once(replay.lines_of(paths))
    assert sum(bool(line.get("comparisons")) for line in kept) >= 40


def test_a_machine_counts_once_by_the_line_that_has_tables(lines):
    bare = {key: value for key, value in lines[0].items() if key != "comparisons"}
    assert replay.once([bare, *lines, bare]) == lines
    assert replay.once([bare, bare]) == [bare]


def test_another_rule_says_something_else(lines):
    found = replay.score(lines, replay.rule_of({"accept": {"least_share": 0.95}}))
    assert found.counts["left out"] == {"unknown": 1}
    assert found.others == ["left out, delay (1): unknown, was named creep"]
    found = replay.score(lines, replay.rule_of({"floor.colour": 3.0}))
    assert found.counts["one effect"] == {"off the path": 1, "no table": 1}


@pytest.mark.parametrize(("driven", "verdict"), [(0.1, "named"), (0.6, "unknown")])
def test_a_machine_that_does_not_need_its_input_is_not_diagnosed(lines, driven, verdict):
    with_input = OtherDecision(INPUT, {"error": 2.0, "error_without_input": 3.0})
    delay = table(row((0.99, 0.99), effect="delay", exact=(True,)))
    line = _line(1, ["delay"], ["delay"], comparisons=_stored(delay, decided=(with_input,)))
    rule = replay.rule_of({"credible.driven": driven})
    (side,) = replay.sides_of(line)
    assert replay.decided(side, rule).verdict == verdict
    if driven != Rule().credible.driven:
        found = replay.score(lines, rule)
        assert found.counts["one effect"] == {"off the path": 1, "no table": 1}


def test_a_rule_is_read_from_files_and_words(tmp_path):
    (tmp_path / "rule.json").write_text(json.dumps({"accept": {"least_share": 0.3}, "rivals.lead": 5.0}))
    rule = replay.read_rule([str(tmp_path / "rule.json"), "accept.least_share=0.2"])
    assert (rule.accept.least_share, rule.rivals.lead) == (0.2, 5.0)
    with pytest.raises(KeyError, match="accept"):
        replay.read_rule(["accept.nothing=1"])


def test_tables_are_kept_with_the_thin_lines(lines):
    for line in lines:
        thin = diagnosis.thinned(line)
        assert thin.get("comparisons") == line.get("comparisons")
    assert diagnosis.thinned(lines[0])["left"]["comparisons"] == lines[0]["left"]["comparisons"]


def test_the_command_prints_a_table(tmp_path, lines, monkeypatch, capsys):
    path = tmp_path / "lines.jsonl.gz"
    with gzip.open(path, "wt") as file:
        file.writelines(json.dumps(line) + "\n" for line in lines)
    monkeypatch.setattr("sys.argv", ["replay", "--lines", str(path)])
    replay.main()
    assert "As the lines say: 3 of 3." in capsys.readouterr().out
    lines[1]["verdict"] = "unknown"
    path.write_bytes(gzip.compress("".join(json.dumps(line) + "\n" for line in lines).encode()))
    with pytest.raises(SystemExit, match="does not reproduce"):
        replay.main()
    monkeypatch.setattr("sys.argv", ["replay", "limits.one=0.05", "--lines", str(path)])
    replay.main()
    assert "{'limits.one': 0.05}" in capsys.readouterr().out


@pytest.mark.parametrize("group", ["floor", "credible", "testable", "residual", "place", "limits.unmeasured"])
def test_numbers_that_no_table_depends_on_are_refused(group, monkeypatch, capsys):
    own = next(one for one in Rule().numbers() if one == group or one.startswith(f"{group}."))
    monkeypatch.setattr("sys.argv", ["replay", f"{own}={2.0 * Rule().numbers()[own]}"])
    with pytest.raises(SystemExit, match="2"):
        replay.main()
    assert "Diagnose anew" in capsys.readouterr().err
