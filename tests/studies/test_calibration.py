"""Calibration: what is counted tells a calibrated diagnosis from an overconfident one; the prior; and the command."""

import dataclasses
import json
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_diagnosis
from helpers_plants import TABLE_I, every_size

import frictionjax as fj
from frictionjax.cli import main
from frictionjax.core import Estimate, InputError
from frictionjax.diagnosis.verdict import MissingEffect
from frictionjax.physics import catalogue
from frictionjax.studies import calibration_task, prior
from frictionjax.studies.calibration import BINS, calibration_of, calibration_study, rank_histogram
from frictionjax.studies.calibration_task import compared
from frictionjax.studies.prior import FAMILIES, Truth, case_like, drawn_effect, drawn_truth

pytest.importorskip("zarr")

DRAWS = 500


NAMES = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
PARAMETERS = tuple(SimpleNamespace(name=name) for name in NAMES)
NOTHING, SOMETHING = adequate_diagnosis(), fake_diagnosis(n=20)


def _truth(family, rng):
    """A machine with a load, or nothing: its numbers alone."""
    friction = SimpleNamespace(parameters=PARAMETERS, **{name: rng.uniform(0.5, 2.0) for name in NAMES})
    load = SimpleNamespace(strengths=(SimpleNamespace(name="load"),), load=rng.normal())
    acts = rng.random() < 0.75
    drive = SimpleNamespace(J=rng.uniform(0.5, 2.0), friction=friction, effects=(load,) if acts else ())
    return Truth(family, ("constant_load",) if acts else (), "ConstantLoad" if acts else "", drive, None)


def _diagnosing(rng, *, errors, confidence):
    """A diagnosis of a truth whose `errors` are so many times as large as it states, and whose names are right with the
    probability `confidence(c)` where it states c."""

    def estimate(true):
        stderr = 0.01 * abs(true)
        return Estimate(true + errors * stderr * rng.standard_normal(), stderr, "1")

    def diagnose(truth, *, progress):
        friction = truth.drive.friction
        extended = {"J": estimate(float(truth.drive.J))}
        extended |= {name: estimate(float(getattr(friction, name))) for name in NAMES}
        if not truth.acting:
            return dataclasses.replace(NOTHING, extended=extended)
        stated = rng.uniform(0.5, 1.0)
        effect = "constant_load" if rng.random() < confidence(stated) else "creep"
        sizes = {"load": estimate(truth.strength[1])} if effect == "constant_load" else {}
        found = MissingEffect(effect, (effect,), stated, 1e-9, sizes, "")
        return dataclasses.replace(SOMETHING, missing=(found,), extended=extended)

    return diagnose


@pytest.fixture
def calibrated(monkeypatch):
    """Runs a calibration with a diagnosis that takes no time."""
    monkeypatch.setattr(calibration_task, "drawn_truth", _truth)
    monkeypatch.setattr(calibration_task, "case_like", lambda truth, rng: truth)

    def run(errors, confidence, draws=DRAWS, **more):
        rng = np.random.default_rng(8)
        made = _diagnosing(rng, errors=errors, confidence=confidence)
        monkeypatch.setattr(calibration_task, "diagnose", made)
        return fj.run_study(calibration_study(draws, seed=4), progress=False, **more)

    return run


def test_a_calibrated_diagnosis_is_seen_to_be_one(calibrated):
    results = calibrated(1.0, lambda stated: stated)
    found = calibration_of(results)
    assert (found.draws, found.failed) == (DRAWS, 0)
    assert [one.parameter for one in found.ranks] == [
        "J",
        "sigma0",
        "sigma1",
        "sigma2",
        "Fc",
        "Fs",
        "vs",
        "strength",
    ]
    for one in found.ranks:
        assert one.p_value > 1e-4
        assert abs(one.inside - 0.95) < 4.0 * one.inside_error
        outside = sum(not one.low <= count <= one.high for count in one.counts)
        assert outside <= 4  # of ten, of which each is outside with a probability of 5 %
    assert abs(found.excess) < 4.0 * found.excess_error
    rows = {(one.family, one.acting): one for one in found.false_names}
    assert rows["all", "any"].machines == DRAWS == sum(rows[name, "any"].machines for name in FAMILIES)
    nothing, an_effect = rows["all", "nothing"], rows["all", "an effect"]
    assert nothing.wrong == 0 and nothing.right == nothing.machines
    assert an_effect.wrong == an_effect.machines - an_effect.right
    # One name in four is wrong: confidences are uniform from 0.5 to 1.
    share = an_effect.wrong / an_effect.machines
    assert abs(share - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / an_effect.machines)
    acting = results["acting"].values == ""
    assert abs(acting.mean() - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / DRAWS)


def test_an_overconfident_diagnosis_is_seen_to_be_one(calibrated):
    found = calibration_of(calibrated(2.0, lambda stated: stated - 0.3))
    for one in found.ranks:
        assert one.p_value < 1e-6
        assert one.inside < 0.95 - 6.0 * one.inside_error
        assert one.counts[0] > one.high and one.counts[-1] > one.high  # a valley between two towers
    assert found.excess > 5.0 * found.excess_error
    assert abs(found.excess - 0.3) < 4.0 * np.sqrt(0.25 / (0.75 * DRAWS))
    for one in found.reliability:
        assert one.right < one.confidence
    assert "too high" in found.sentences[1]


def test_too_wide_errors_pile_up_in_the_middle(calibrated):
    found = calibration_of(calibrated(0.5, lambda stated: 1.0))
    for one in found.ranks:
        assert one.p_value < 1e-6 and max(one.counts[0], one.counts[-1]) < one.low
    assert found.excess < -5.0 * found.excess_error and "too low" in found.sentences[1]


def test_a_calibration_goes_on_where_it_stopped(calibrated, monkeypatch, tmp_path):
    whole = calibrated(1.0, lambda stated: stated, draws=12)["acting"].values
    known, count = calibration_task.drawn_truth, []

    def stops(family, rng):
        count.append(family)
        if len(count) == 6:
            raise KeyboardInterrupt
        return known(family, rng)

    monkeypatch.setattr(calibration_task, "drawn_truth", stops)
    store = tmp_path / "c.zarr"
    with pytest.raises(KeyboardInterrupt, match="5 of 12 cases are finished"):
        calibrated_again = fj.run_study(calibration_study(12, seed=4), store, progress=False, chunk=1)
    calibrated_again = fj.run_study(calibration_study(12, seed=4), store, progress=False, chunk=1)
    assert len(count) == 6 + 7
    np.testing.assert_array_equal(calibrated_again["acting"].values, whole)


def test_ranks_are_probabilities_below_the_true_value():
    drive = TABLE_I.with_effects(catalogue()["constant_load"][0](load=0.2))
    truth = Truth("bench", ("constant_load",), "ConstantLoad", drive, None)
    extended = {
        "J": Estimate(1.0, 0.1, "kg"),
        "Fc": Estimate(1.0 + 1.96 * 0.1, 0.1, "N"),
        "Fs": Estimate(1.0, 0.1, "N", identified=False),
    }
    missing = MissingEffect(
        "constant_load", ("constant_load",), 0.9, 0.0, {"load": Estimate(0.1, 0.1, "N")}, ""
    )
    found = dataclasses.replace(fake_diagnosis(n=20), missing=(missing,), extended=extended)
    ranks = dict(zip(calibration_task.RANKED, compared(found, truth)["rank"], strict=True))
    assert ranks["J"] == 0.5 and ranks["Fc"] == pytest.approx(0.025, abs=1e-4)
    assert ranks["strength"] == pytest.approx(0.8413, abs=1e-4)
    assert np.isnan(ranks["Fs"]) and np.isnan(ranks["sigma0"])
    other = dataclasses.replace(missing, effect="creep", effect_class=("creep", "constant_load"))
    result = compared(dataclasses.replace(found, missing=(other,)), truth)
    assert result["right"] and result["name_right"][0] == 1.0 and np.all(np.isnan(result["rank"]))


def test_the_band_is_binomial():
    found = rank_histogram("J", (np.arange(200) + 0.5) / 200)
    assert list(found.counts) == [20] * BINS and found.p_value == 1.0
    assert found.low < 20 - 1.6 * np.sqrt(18) and found.high > 20 + 1.6 * np.sqrt(18)


@pytest.mark.parametrize("form", [form for forms in catalogue().values() for form in forms])
def test_every_effect_of_the_prior_acts_and_is_in_its_range(form):
    for seed in range(5):
        effect = drawn_effect(form, every_size(0.7), np.random.default_rng(seed))
        assert any(float(getattr(effect, one.name)) != 0.0 for one in form.strengths)
        for one in (*form.strengths, *form.nuisances):
            assert one.lower <= float(getattr(effect, one.name)) <= one.upper


def test_a_machine_of_the_prior_moves_and_is_drawn_again_the_same(monkeypatch):
    monkeypatch.setattr(prior, "NOTHING", 1.0)
    case, again = (
        case_like(drawn_truth("poor", np.random.default_rng(3)), np.random.default_rng(4)) for _ in range(2)
    )
    assert {one.role for one in case.recordings} == {"fit", "holdout"}
    for one, other in zip(case.recordings, again.recordings, strict=True):
        np.testing.assert_array_equal(one.x, other.x)
        assert np.ptp(one.x) > 10.0 * 1e-3  # beyond any break-away deflection of the prior: it slides


def test_what_is_no_calibration_is_a_sentence(calibrated, monkeypatch):
    with pytest.raises(InputError, match="`draws` is 0"):
        calibration_study(0)
    with pytest.raises(InputError, match="no results of a calibration"):
        calibration_of({})

    def fails(truth, *, progress):
        raise InputError("nothing moves")

    calibrated(1.0, lambda stated: 1.0, draws=2)
    monkeypatch.setattr(calibration_task, "diagnose", fails)
    with pytest.warns(fj.FrictionjaxWarning, match="2 of 2 cases failed"):
        results = fj.run_study(calibration_study(2), progress=False)
    assert list(results["acting"].values) == [
        text for text in results["acting"].values if text in ("", "constant_load")
    ]
    with pytest.raises(
        InputError, match="none of the 2 machines could be diagnosed: InputError: nothing moves"
    ):
        calibration_of(results)


def test_the_command_writes_a_store_a_summary_and_a_figure(calibrated, tmp_path, capsys, monkeypatch):
    calibrated(1.0, lambda stated: stated, draws=1)
    monkeypatch.chdir(tmp_path)
    assert main(["study", "calibrate", "--draws", "30", "--out", "c.zarr"]) == 0
    printed = capsys.readouterr().out
    assert "Of 30 machines of the prior" in printed and "Written: c.zarr, c.json, c.png" in printed
    summary = json.loads((tmp_path / "c.json").read_text())
    assert summary["draws"] == 30 and summary["ranks"][0]["parameter"] == "J"
    assert sum(summary["ranks"][0]["counts"]) <= 30
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    assert main(["study", "calibrate", "--draws", "30", "--out", "c.zarr"]) == 2
    assert "there are results of an earlier run" in capsys.readouterr().err
    assert main(["study", "calibrate", "--draws", "30", "--out", "c.zarr", "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == summary


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["study", "calibrate", "--out", "c.zarr"], "a calibration needs `--draws` and `--out`"),
        (["study", "calibrate", "--draws", "3"], "a calibration needs `--draws` and `--out`"),
        (["study", "design.toml", "--out", "s", "--draws", "3"], "`--draws` is for `study calibrate`"),
    ],
)
def test_what_the_command_lacks_is_one_line(arguments, words, capsys):
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_a_real_machine_of_the_prior_is_diagnosed():
    results = fj.run_study(calibration_study(1, seed=2), progress=False)
    found = calibration_of(results)
    assert found.draws == 1 and found.false_names[0].machines == 1


@pytest.mark.slow
def test_the_program_is_stopped_and_goes_on(tmp_path):
    command = [sys.executable, "-m", "frictionjax", "study", "calibrate", "--draws", "2", "--chunk", "1"]
    options = ["--out", str(tmp_path / "c.zarr")]
    running = subprocess.Popen([*command, *options], stderr=subprocess.PIPE, text=True)
    shards = tmp_path / "c.zarr.parts"
    while running.poll() is None and not list(shards.glob("*.npz")):
        time.sleep(0.1)
    (first,) = shards.glob("*.npz")
    running.send_signal(signal.SIGINT)
    _, said = running.communicate()
    assert running.returncode == 130 and "--resume" in said
    made = first.stat().st_mtime_ns
    again = subprocess.run([*command, *options, "--resume"], capture_output=True, text=True, check=True)
    assert "Of 2 machines of the prior" in again.stdout
    assert not first.exists() or first.stat().st_mtime_ns == made
    assert json.loads((tmp_path / "c.json").read_text())["draws"] == 2
