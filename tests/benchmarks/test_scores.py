"""Scores of the blind challenge on hand-made verdicts whose scores are known, and what the simulator witnesses."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")

from helpers_challenge import answer, truth, verdict

from benchmarks.concealed.figures import figures, hero_of
from benchmarks.concealed.intervals import bootstrapped, wilson
from benchmarks.concealed.reality import make_case
from benchmarks.concealed.reveal import page
from benchmarks.concealed.scores import scores
from benchmarks.concealed.tables import TABLES, kept, rivals, series, summary
from benchmarks.concealed.witness import REGIMES, missing_force, regime_of

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def answers():
    """Ten cases: three nothing, four single effects, one of two, two outside."""
    size = {"constant_load": {"force": 2.0}}
    both = {"delay": ("delay", "drive_lag")}
    free = {"free_form": {"holdout": {"holdout": [1e-5, 4e-6]}}}
    geometry = {"geometry": {"names": ["creep", "delay"], "cosines": [[1.0, 0.4], [0.4, 1.0]]}}
    r2 = {"largest_r2": {"named": "creep", "seconds": 2.0}}
    return [
        answer("case_001", truth("nothing"), verdict(base=1.0)),
        answer("case_002", truth("nothing"), verdict("delay"), rivals=r2),
        answer("case_003", truth("nothing"), verdict(word="unknown")),
        answer(
            "case_004",
            truth("one", "constant_load", sizes=size),
            verdict("constant_load", size=("load", 2.1, 0.1), extended=2.0),
            energy={"sliding": 0.8, "stick": 0.2},
            rivals=free | geometry | r2,
        ),
        answer(
            "case_005",
            truth("one", "constant_load", strength="medium", sizes=size),
            verdict("constant_load", size=("load", 2.4, 0.1), extended=1.0),
            energy={"sliding": 0.1, "stick": 0.9},
        ),
        answer("case_006", truth("one", "drive_lag"), verdict("delay", classes=both)),
        answer("case_007", truth("one", "creep", strength="weak"), verdict(word="unknown")),
        answer("case_008", truth("two", "creep", "ripple"), verdict("creep", "delay")),
        answer("case_009", truth("outside", "outside:x"), verdict(word="unknown")),
        answer("case_010", truth("outside", "outside:y"), verdict("ripple")),
    ]


def test_intervals():
    # Wilson 1927; the numbers are those of any table: 8 of 10.
    assert wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(0, 30)[1] == pytest.approx(0.1135, abs=1e-4)
    draws = np.random.default_rng(1).normal(5.0, 2.0, 400)
    found = bootstrapped(list(draws), lambda some: float(np.mean(some)))
    assert found["high"] - found["low"] == pytest.approx(2 * 1.96 * np.std(draws) / 20.0, rel=0.15)
    assert bootstrapped([], lambda some: 1.0)["value"] is None


def test_scores_of_known_verdicts(answers):
    found = scores(answers)
    seen = found["naming"]["strong_and_medium"]
    assert (seen["hits"], seen["of"]) == (3, 3)
    assert found["naming"]["strong_and_medium_top_1"]["hits"] == 2
    assert found["naming"]["by_effect"]["creep"] == {"weak": ["unknown"]}
    assert found["naming"]["by_effect"]["drive_lag"] == {"strong": ["class"]}
    alarms = found["alarms"]
    counted = {
        name: (alarms[name]["hits"], alarms[name]["of"]) for name in alarms if name != "outside_by_kind"
    }
    assert counted == {
        "false_alarms": (2, 3),
        "false_names": (1, 3),
        "outside_noticed": (2, 2),
        "outside_flagged": (1, 2),
        "outside_named": (1, 2),
    }
    assert found["two_f1"]["value"] == pytest.approx(0.5)  # one hit of two concealed and two named
    assert found["sizes"]["error"]["value"] == pytest.approx(0.125)  # 5 % and 20 %
    assert (found["sizes"]["coverage"]["hits"], found["sizes"]["coverage"]["of"]) == (1, 2)
    assert (found["localisation"]["top_bin"]["hits"], found["localisation"]["top_bin"]["of"]) == (1, 2)
    assert found["localisation"]["energy_in_it"]["value"] == pytest.approx(0.45)
    assert found["held_out"]["error"]["free_form"]["value"] == pytest.approx(4.0)
    # (10 - 2) / 9 and four times (10 - 1) / 9; in two of these nothing was named, but the model is as good.
    assert found["held_out"]["recovery"]["all"]["value"] == pytest.approx(1.0)
    assert answers[3].recovery == pytest.approx(8 / 9)
    assert answers[0].recovery is None
    assert found["rivals"]["largest_r2"]["false_names"]["hits"] == 1
    assert found["rivals"]["largest_r2"]["right"]["hits"] == 0
    assert found["stated_together"] == {"delay, drive_lag": 1}
    assert found["overlap"]["cosines"] == [[1.0, 0.4], [0.4, 1.0]]
    row = found["confusion"]["counts"][found["confusion"]["rows"].index("drive_lag")]
    assert found["confusion"]["columns"][int(np.argmax(row))] == "delay"
    assert json.loads(json.dumps(found, allow_nan=False)) == json.loads(json.dumps(found))


def test_a_reliable_confidence_is_reported_from_one_that_is_not():
    def batch(confidence, right):
        return [
            answer(
                f"case_{k}",
                truth("one", "creep" if k < right else "delay"),
                verdict("creep", confidence=confidence),
            )
            for k in range(20)
        ]

    sound, proud = (scores(batch(c, 14))["calibration"] for c in (0.7, 0.99))
    assert sound["brier"]["value"] == pytest.approx(0.21)
    assert proud["brier"]["value"] > 0.29
    assert sum(point["of"] for point in sound["curve"]) == 20


def test_tables_and_page_tell_the_scores(answers):
    found = scores(answers)
    text = {head: table(found) for head, table in TABLES.items()}
    assert (
        "| false alarms, nothing hidden | 67 % (21 to 94), 2 of 3 | at most 2 % |" in text["What was reached"]
    )
    assert "| constant_load | 1 named | 1 named |  |" in text["By effect"]
    drawn = figures(answers, found)
    assert {"confusion", "power", "held_out", "reliability"} <= set(drawn)
    assert hero_of(answers) is None  # nothing to draw: no trace was kept
    solver = {"frictionjax": "1", "commit": "abc", "cores": 2}
    html = page({"scores": found, "seed": 1, "sealed": "ff", "solver": solver}, drawn)
    assert html.count("<img") == len(drawn)
    assert "67 % (21 to 94)" in html


def test_the_hero_is_the_right_name_nearest_to_the_noise(answers):
    trace = {
        "trace": {"recording": "holdout", "t": [0.0, 1.0], "x": [0.0, 1.0], "predicted_base": [0.0, 1.0]}
    }
    trace["trace"] |= {"stretch": [0.5], "error_base": [3.0], "error_extended": [1.0]}
    right = [
        answer(f"case_{k}", truth("one", "creep"), verdict("creep", base=base, extended=after) | trace)
        for k, (base, after) in enumerate([(50.0, 1.0), (3.0, 1.1), (2.0, 1.9)])
    ]
    wrong = answer("case_9", truth("one", "delay"), verdict("creep", base=1.5, extended=1.0) | trace)
    assert hero_of([*right, wrong]).name == "case_1"
    assert "hero" in figures([*right, wrong], scores([*right, wrong]))


def test_the_witness_sees_where_an_effect_acts_and_predicts_to_the_noise():
    case = make_case(11, ("quadratic_drag",), families="sliding", stretch=0.25, substeps=16, horizon=0.1)
    index = next(i for i, r in enumerate(case.recordings) if r["name"] == "holdout_moves")
    recording, hidden = case.recordings[index], case.hidden[index]
    km, base = case.plant["motor_constant"], case.truth["base"]
    lacks, v, bend = missing_force(recording["u"], hidden.clean, recording["sample_rate"], km, base)
    sliding = regime_of(v, bend, base["vs"], float(np.abs(v).max())) == REGIMES.index("sliding")
    drag = case.truth["sizes"]["quadratic_drag"]["coefficient"] * v * np.abs(v)
    assert np.corrcoef(lacks[sliding], drag[sliding])[0, 1] > 0.95
    assert np.sum(lacks[sliding] ** 2) > 0.5 * np.sum(lacks**2)
    scored = np.isfinite(hidden.ahead)
    assert scored.mean() > 0.9
    blind = np.std(recording["x"][200:] - recording["x"][:-200])
    assert np.sqrt(np.mean((hidden.ahead - recording["x"])[scored] ** 2)) < 0.01 * blind


# The pages that quote the batches


def _rows(text):
    return {line for line in text.splitlines() if line.startswith("| ")}


def test_the_page_of_the_challenge_has_what_the_last_batch_measured():
    """Its tables are rows of what `reveal` prints from the scores that are kept, and its seed and seal are theirs."""
    last = sorted((ROOT / "benchmarks" / "concealed" / "results").glob("*.json"))[-1]
    results = json.loads(last.read_text(encoding="utf-8"))
    scores = results["scores"]
    assert scores["cases"] >= 120
    assert not results["solver"]["changed_files"]
    page = (ROOT / "docs" / "blind-challenge.md").read_text(encoding="utf-8")
    section = page.split("## The last batch of 120 cases")[1].split("\n## ")[0]
    quoted = _rows(section)
    measured = _rows(summary(scores)) | _rows(rivals(scores))
    assert len(quoted) > 10
    assert quoted <= measured
    assert f"seed {results['seed']}" in section
    assert results["sealed"][:16] in section
    assert results["solver"]["commit"][:7] in section
    right, alarms = scores["naming"]["strong_and_medium"], scores["alarms"]["false_alarms"]
    headline = (
        f"{right['hits']} of {right['of']} named right, {alarms['hits']} of {alarms['of']} false alarms"
    )
    assert headline in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_page_of_the_challenge_has_every_batch_that_is_kept():
    batches = kept()
    assert [batch["seed"] for batch in batches] == sorted({batch["seed"] for batch in batches})
    assert len(batches) >= 5
    page = (ROOT / "docs" / "blind-challenge.md").read_text(encoding="utf-8")
    assert series(batches) in page
    record = (ROOT / "docs" / "benchmarks" / "blind-challenge.md").read_text(encoding="utf-8")
    assert all(f"seed {batch['seed']}" in record for batch in batches)


@pytest.mark.parametrize(
    "path",
    sorted((ROOT / "benchmarks" / "concealed" / "results" / "smaller").glob("*.json")),
    ids=lambda path: path.stem,
)
def test_a_smaller_batch_is_quoted_with_its_number_of_cases_and_its_seal(path):
    results = json.loads(path.read_text(encoding="utf-8"))
    cases, commit = results["scores"]["cases"], results["solver"]["commit"][:7]
    assert cases < 120 and not results["solver"]["changed_files"]
    record = (ROOT / "docs" / "benchmarks" / "blind-challenge.md").read_text(encoding="utf-8")
    section = record.split(f"seed {path.stem}, {cases} cases")[1].split("\n## ")[0]
    assert results["sealed"][:16] in section and f"commit {commit}" in section
