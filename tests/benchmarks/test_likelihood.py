"""Names by likelihood alone, against those by shares of the misfit, on stored tables."""

import json

import pytest
from helpers_rule import row, table

pytest.importorskip("numba")

from benchmarks import likelihood
from benchmarks.concealed.seal import close, digest_of_case
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import Lead, table_json

RULE = Rule()


def _row(effect, fit, held_out, shares=(0.9, 0.9), clusters=100):
    leads = {"fit": Lead(fit, 10.0, clusters), "held_out": Lead(held_out, 10.0, clusters)}
    return row(shares, effect=effect, **leads)


def test_the_likelier_one_is_named_whatever_it_explains():
    small = table(_row("delay", 50.0, 45.0, (0.2, 0.2)), _row("creep", 90.0, 31.0, (0.1, 0.1)), lead=-9.0)
    assert likelihood.by_shares(small, RULE).name is None
    assert likelihood.by_likelihood(small, RULE) == likelihood.Choice("creep")
    # Nothing of a candidate was determined by the held-out recordings: there it must be likelier, too.
    each = RULE.changed({"accept.lead_each": 4.0})
    assert likelihood.by_likelihood(small, each) == likelihood.Choice("delay")
    assert likelihood.by_likelihood(small, RULE.changed({"accept.lead": 9.0})) == likelihood.Choice(None)


def test_what_does_not_trail_clearly_is_of_the_class():
    close_by = table(_row("delay", 50.0, 50.0), _row("drive_lag", 49.0, 50.0), lead=1.0)
    found = likelihood.by_likelihood(close_by, RULE)
    assert found == likelihood.Choice("delay", ("drive_lag",))
    assert [found.outcome(hidden) for hidden in (("delay",), ("drive_lag",), ("creep",))] == [
        "right",
        "class",
        "other",
    ]
    assert likelihood.Choice(None).outcome(()) == "none"


def test_what_is_taken_first_is_counted_by_the_share_that_it_explains():
    tables = [
        table(_row("delay", 50.0, 50.0, (0.95, 0.35)), _row("creep", 49.0, 40.0)),
        table(_row("delay", 50.0, 50.0, (0.05, 0.9))),
        table(_row("delay", 50.0, 50.0, clusters=3)),
    ]
    cases = [
        likelihood.Case("", "one", (missing,), "named", one) for missing in ("delay", "x") for one in tables
    ]
    lines = likelihood.shares(cases, RULE).splitlines()
    assert lines[0] == "| share from | right | class | other |"
    assert "| 0.3 | 1 | 0 | 1 |" in lines and "| 0 | 1 | 0 | 1 |" in lines
    assert sum("1" in line.split("|", 2)[2] for line in lines) == 2


def test_without_clusters_nothing_is_sure():
    assert likelihood.by_likelihood(table(_row("delay", 90.0, 90.0, clusters=3)), RULE).name is None


def test_both_are_counted_and_where_they_differ_is_listed():
    small = table(_row("delay", 50.0, 45.0, (0.2, 0.2)))
    content = {"comparisons": {"tables": [table_json(small)]}, "verdict": "unknown"}
    lines = [
        {"name": "a", "missing": ["delay"], **content},
        {"name": "b", "missing": [], **content},
        {"name": "c", "missing": ["x"], "stratum": "outside", **content, "comparisons": {"tables": []}},
    ]
    cases = list(likelihood.cases_of(lines))
    assert [case.stratum for case in cases] == ["one", "nothing"]
    text = likelihood.compare(cases, RULE)
    assert "| one | shares | 0 | 0 | 0 | 1 |" in text and "| one | likelihood | 1 | 0 | 0 | 0 |" in text
    assert "| nothing | likelihood | 0 | 0 | 1 | 0 |" in text
    assert "| a | delay | unknown |  (none) | delay (right) |" in text


def test_solved_cases_of_a_batch_become_lines(tmp_path):
    own = {"stratum": "confusable", "missing": ["delay"], "strength": "weak", "families": "joint"}
    stored = {"rule": {}, "rounds": 3, "tables": [table_json(table(_row("delay", 50.0, 45.0)))] * 2}
    found = {"effect": "delay", "class": ["delay", "drive_lag"]}
    said = {"verdict": "named", "missing": [found], "comparisons": stored, "seconds": {"total": 12.0}}
    solved = tmp_path / "solved" / "case_001"
    solved.mkdir(parents=True)
    (solved / "verdict.json").write_text(json.dumps(said))
    for name in ("case_001", "case_002"):  # the second one is not solved yet
        (tmp_path / "cases" / name).mkdir(parents=True)
        (tmp_path / "cases" / name / "case.toml").write_text(name)
    cases = {
        name: own | {"files": digest_of_case(tmp_path / "cases" / name)} for name in ("case_001", "case_002")
    }
    close(tmp_path, {"seed": 7, "cases": cases})
    (line,) = likelihood.collected(tmp_path)
    assert (line["name"], line["stratum"], line["named"]) == ("7 case_001", "one", ["delay"])
    (case,) = likelihood.cases_of([line])
    assert likelihood.by_shares(case.table, RULE).name == "delay"

    # The command line keeps the comparisons in a file beside the verdict.
    (solved / "verdict.json").write_text(json.dumps({k: v for k, v in said.items() if k != "comparisons"}))
    with pytest.raises(FileNotFoundError):
        list(likelihood.collected(tmp_path))
    (solved / "comparisons.json").write_text(json.dumps(stored))
    assert list(likelihood.collected(tmp_path)) == [line]


def test_what_was_said_is_counted_by_family():
    known = {
        "families": "joint",
        "strength": "strong",
        "verdict": "named",
        "named": [],
        "classes": [],
        "seconds": 10.0,
    }

    def line(stratum, missing=(), named=(), rivals=(), **more):
        return (
            known
            | {"stratum": stratum, "missing": missing, "named": named, "classes": [[*named, *rivals]]}
            | more
        )

    lines = [
        line("nothing", verdict="adequate"),
        line("nothing"),
        line("one", ["delay"], ["delay"]),
        line("one", ["delay"], ["drive_lag"], ["delay"], families="poor", seconds=30.0),
        line("one", ["delay"], ["creep"], strength="weak"),
        line("two", ["delay", "creep"], ["creep"]),
        line("outside", ["outside: x"], verdict="unknown", seconds=20.0),
        line("outside", ["outside: x"], ["creep"]),
    ]
    text = likelihood.tally(lines)
    assert "| joint | 1 of 2 | 1, 0, 0, 0 | 1 of 2 | 1, 1 of 2 |" in text
    assert "| all | 1 of 2 | 1, 1, 0, 0 | 1 of 2 | 1, 1 of 2 |" in text
    assert text.endswith("median 10 s")
