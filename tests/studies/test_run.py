"""`run_study`: the same numbers whoever runs it, resumed from disk, failures reported."""

import json
import math
import statistics
from concurrent.futures import ThreadPoolExecutor

import pytest

from frictionjax import Design, InputError, run_study
from frictionjax.studies import grid

CALLS = []


def draw(*, seed, gain, kind="plain"):
    """A number that depends on the case and on the seed."""
    CALLS.append((gain, seed))
    return {"value": gain * (1.0 + 0.1 * math.sin(seed)), "bound": math.inf if kind == "open" else 1.0}


def fragile(*, seed, gain):
    if seed == 1:
        raise ZeroDivisionError(f"no draw {seed} at {gain}")
    return {"value": gain + seed}


def test_a_grid_holds_every_combination_the_last_axis_fastest():
    assert grid(a=(1, 2), b=("x", "y")) == (
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    )


def test_an_executor_changes_nothing_but_who_works():
    design = Design(draw, grid(gain=(1.0, 2.0, 3.0)), seeds=5, seed=7)
    alone = run_study(design)
    with ThreadPoolExecutor(2) as pool:
        together = run_study(design, pool)
    assert alone.runs == together.runs
    assert [(run["gain"], run["seed"]) for run in alone.runs[4:6]] == [(1.0, 11), (2.0, 7)]


def test_the_summary_is_mean_deviation_and_error_of_each_case():
    study = run_study(Design(draw, grid(gain=(2.0,), kind=("plain", "open")), seeds=4))
    plain, unbounded = study.summary()
    values = [2.0 * (1.0 + 0.1 * math.sin(seed)) for seed in range(4)]
    assert plain["runs"] == 4 and plain["kind"] == "plain"
    assert plain["value"] == pytest.approx(statistics.fmean(values), rel=1e-12)
    assert plain["value_std"] == pytest.approx(statistics.stdev(values), rel=1e-12)
    assert plain["value_stderr"] == pytest.approx(statistics.stdev(values) / 2.0, rel=1e-12)
    assert unbounded["bound"] is None and unbounded["bound_std"] is None


def test_a_stopped_study_runs_only_what_is_missing(tmp_path):
    out = tmp_path / "deep" / "runs.jsonl"
    run_study(Design(draw, grid(gain=(1.0,)), seeds=3), out=out)
    whole = out.read_text(encoding="utf-8")
    out.write_text(whole[:-10], encoding="utf-8")  # stopped in the middle of the third line
    CALLS.clear()
    grown = run_study(Design(draw, grid(gain=(1.0, 5.0)), seeds=3), out=out)
    assert CALLS == [(1.0, 2), (5.0, 0), (5.0, 1), (5.0, 2)]
    assert grown.resumed == 2
    assert grown.runs == run_study(Design(draw, grid(gain=(1.0, 5.0)), seeds=3)).runs
    assert len([json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]) == 6


def test_another_function_does_not_take_over_results(tmp_path):
    out = tmp_path / "runs.jsonl"
    run_study(Design(draw, grid(gain=(1.0,)), seeds=1), out=out)
    assert run_study(Design(fragile, grid(gain=(1.0,)), seeds=1), out=out).resumed == 0


def test_a_value_that_is_not_finite_survives_the_disk(tmp_path):
    out = tmp_path / "runs.jsonl"
    design = Design(draw, grid(gain=(1.0,), kind=("open",)), seeds=1)
    run_study(design, out=out)
    assert "Infinity" not in out.read_text(encoding="utf-8")
    assert math.isnan(run_study(design, out=out).runs[0]["bound"])


@pytest.mark.parametrize("threads", [0, 2])
def test_a_run_that_fails_is_reported_and_the_others_go_on(threads, tmp_path):
    design, out = Design(fragile, grid(gain=(1.0, 2.0)), seeds=3), tmp_path / "runs.jsonl"
    if threads:
        with ThreadPoolExecutor(threads) as pool:
            study = run_study(design, pool, out=out)
    else:
        study = run_study(design, out=out)
    assert [(run["gain"], run["seed"]) for run in study.runs] == [(1.0, 0), (1.0, 2), (2.0, 0), (2.0, 2)]
    assert [failure["error"] for failure in study.failures] == [
        "ZeroDivisionError: no draw 1 at 1.0",
        "ZeroDivisionError: no draw 1 at 2.0",
    ]
    assert run_study(design, out=out).resumed == 4


def test_when_every_run_fails_the_error_is_raised():
    with pytest.raises(ZeroDivisionError, match="no draw 1"):
        run_study(Design(fragile, grid(gain=(1.0,)), seeds=1, seed=1))


def test_progress_reaches_one():
    reported = []
    run_study(
        Design(draw, grid(gain=(1.0, 2.0)), seeds=2),
        progress=lambda stage, fraction: reported.append((stage, fraction)),
    )
    assert reported == [("runs", 0.25), ("runs", 0.5), ("runs", 0.75), ("runs", 1.0)]


def test_bad_designs_and_files_get_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"case 0 cannot be written as JSON.*make arrays inside"):
        run_study(Design(draw, ({"gain": object()},)))
    with pytest.raises(InputError, match=r"case 1 has an entry `seed`"):
        run_study(Design(draw, ({"gain": 1.0}, {"gain": 1.0, "seed": 3})))
    out = tmp_path / "runs.jsonl"
    out.write_text('{"run": {}, "result": {}}\nnothing\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"runs\.jsonl, line 2: the line is not a finished run"):
        run_study(Design(draw, grid(gain=(1.0,))), out=out)
