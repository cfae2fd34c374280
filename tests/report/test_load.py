"""A saved diagnosis read back: the same numbers, and a sentence for what cannot be read."""

import dataclasses
import json
import math

import numpy as np
import pytest
from helpers_diagnosis import adequate_diagnosis, fake_check, fake_diagnosis, fake_recording

import frictionjax as fj
from frictionjax.diagnosis.effort import Effort, ScreeningEffort
from frictionjax.diagnosis.recording_fit import ClosedLoop, Unmeasured
from frictionjax.diagnosis.rule import Rule, VerdictRule
from frictionjax.diagnosis.table import ComparisonTable, Lead, ModelComparison, OtherDecision
from frictionjax.diagnosis.verdict import Ceiling, MismatchBin, NextExperiment, OneStep, SimulationAsGiven
from frictionjax.report.save import comparisons_json, verdict_json


def _full():
    """A diagnosis in which nothing has its default."""
    row = ModelComparison(
        before=(), after=("MaxwellSlip",), effect="maxwell_slip", form="MaxwellSlip", exact=(True,),
        misfits_before=(1.0, 2.0), misfits_after=(0.1, math.nan), misfit_errors=(0.1, 0.2), energies=(0.5, 0.4),
        fit=Lead(3.0, 1.0, 9), held_out=Lead(2.0, 1.0, 8), waves=((math.inf, True),), gains_fit=(0.5, 0.25),
    )  # fmt: skip
    table = ComparisonTable(
        "1", ("candidates", "1"), (), (1.0, 2.0), (0.1, 0.2), False, (row,), ((0, 0, Lead(1.0, 2.0, 3)),)
    )
    found = fake_diagnosis(n=200)
    experiment = NextExperiment(
        ("maxwell_slip", "elasto_plastic"), "triangles", 4.5, 12.0, np.linspace(0.0, 0.1, 7), 1000.0, "Do it."
    )
    missing = dataclasses.replace(
        found.missing[0], next_experiment=experiment, evidence=(1.0, 2.0, math.nan, 0.5)
    )
    return dataclasses.replace(
        found,
        recordings=(*map(_as_given, found.recordings), fake_recording("a/b", n=200, drive="motion")),
        missing=(missing,),
        comparisons=(table,),
        decided=(OtherDecision("input is needed", {"error": 2.5, "error_without_input": math.inf}),),
        rule=Rule(limits=VerdictRule(one=0.0625)),
        effort=Effort(rounds=2, screening=ScreeningEffort(first_forms=4)),
        unmeasured=Unmeasured(0.1, 0.01, math.nan),
        ceiling=Ceiling(
            0.3,
            0.1,
            0.7,
            0.6,
            8.0,
            0.025,
            0.05,
            0.02,
            "velocity",
            True,
            (OneStep("kept", 6.0, 2.0, math.nan),),
        ),
        given=SimulationAsGiven(
            "column", "It misses.", "sliding", (MismatchBin("regime", "sliding", 1.0, 9.0),)
        ),
        check=fake_check(),
    )


def _as_given(recording):
    """Of two kinds: a model of the case, and a column of the recording, which predicts nothing."""
    if recording.role == "fit":
        return dataclasses.replace(
            recording, free_run_rmse_given=0.25, prediction_rmse_given=0.125, sensor_noise=1e-7
        )
    return dataclasses.replace(
        recording,
        free_run_rmse_given=0.25,
        free_given=recording.x + 1e-4,
        increment_rmse_given=0.0625,
        closed_loop=ClosedLoop(2e-3, math.inf, 0.5, 0.25, given=4e-3, input_given=0.75),
    )


@pytest.mark.parametrize("make", [_full, fake_diagnosis, adequate_diagnosis])
def test_what_was_saved_comes_back(make, tmp_path):
    saved = make()
    found = fj.load_diagnosis(fj.save_diagnosis(saved, tmp_path / "out", report=False))
    assert verdict_json(found) == verdict_json(saved)
    assert comparisons_json(found) == comparisons_json(saved)
    assert (found.rule, found.effort, found.plant) == (saved.rule, saved.effort, saved.plant)
    assert found.decided == saved.decided
    assert found.check == saved.check
    assert repr(found.ceiling) == repr(saved.ceiling)
    assert found.base.keys() == saved.base.keys()
    assert repr(found) == repr(saved)
    for one, other in zip(found.recordings, saved.recordings, strict=True):
        assert (one.name, one.role, one.drive) == (other.name, other.role, other.drive)
        for name in ("t", "u", "x", "predicted_extended", "residual_force_extended", "residual_force_std"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-8, atol=1e-12)
        assert (one.force is None) == (other.force is None)
        assert (one.free_given is None) == (other.free_given is None)
        assert (one.prediction_rmse_given is None) == (other.prediction_rmse_given is None)
        assert one.sensor_noise == other.sensor_noise and one.one_sample_floor == other.one_sample_floor
        assert (one.closed_loop is None) == (other.closed_loop is None)
        if one.closed_loop is not None:
            assert one.closed_loop.law is None and one.closed_loop.input_given == 0.75


def test_what_is_not_finite_comes_back_as_such(tmp_path):
    found = fj.load_diagnosis(fj.save_diagnosis(_full(), tmp_path, report=False) / "verdict.json")
    assert found.base["sigma2"] == fj.Estimate(0.057, math.inf, "N*m*s/rad", identified=False)
    assert math.isnan(next(c for c in found.candidates if c.effect == "backlash").p_value)
    assert found.missing[0].next_experiment.between == ("maxwell_slip", "elasto_plastic")
    assert "is named" in found.explain("maxwell_slip")
    assert found.explain("maxwell_slip").endswith("would show: share 0.01.")


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda c: c.pop("plant"), "field `plant`: the field is missing"),
        (lambda c: c.update(schema="frictionjax.verdict/0"), "the schema is .*verdict/0"),
        (lambda c: c.update(verdict="perfect"), "perfect is not a verdict"),
        (lambda c: c["fit"]["only"].pop("role"), "field `fit.only.role`: the field is missing"),
        (lambda c: c["unexplained"].update(more=1), "has other fields"),
        (
            lambda c: c["base"]["parameters"]["J"].update(value="a"),
            'field `base.parameters.J.value`: "a" is not',
        ),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_its_field(damage, words, tmp_path):
    fj.save_diagnosis(adequate_diagnosis(), tmp_path, report=False)
    file = tmp_path / "verdict.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    damage(content)
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(fj.InputError, match=rf"verdict\.json.*{words}.*iagnose the case again"):
        fj.load_diagnosis(tmp_path)


def test_a_folder_without_a_diagnosis_and_a_broken_file_are_refused(tmp_path):
    with pytest.raises(fj.InputError, match="does not exist"):
        fj.load_diagnosis(tmp_path)
    fj.save_diagnosis(adequate_diagnosis(), tmp_path, report=False)
    (tmp_path / "fit" / "only.csv").write_text("t,u\n1,2\n", encoding="ascii")
    with pytest.raises(fj.InputError, match="there is no column `x`"):
        fj.load_diagnosis(tmp_path)
    (tmp_path / "verdict.json").write_text("{", encoding="utf-8")
    with pytest.raises(fj.InputError, match="is not JSON"):
        fj.load_diagnosis(tmp_path)
