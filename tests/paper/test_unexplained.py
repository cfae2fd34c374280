"""The question that the paper leaves open: the recordings of each twin, and (slow) what `diagnose` says of them."""

import numpy as np
import pytest

from frictionjax.paper.experiments import Twin, case_of, explain, twins
from frictionjax.paper.experiments.unexplained import ANSWERS, FINER, rigid
from frictionjax.physics import catalogue
from frictionjax.recordings import audit


@pytest.fixture(scope="module")
def case():
    return case_of(Twin(), seed=1)


def test_the_answers_are_words_of_the_catalogue():
    assert {twin.name for twin in twins()} == set(ANSWERS)
    assert set(ANSWERS.values()) - {None} <= set(catalogue())


def test_only_friction_differs_from_a_lugre_drive():
    for twin in twins():
        machine = rigid(twin)
        assert (machine.arm_share, machine.delay) == (0.0, 0)
        assert (machine.share, machine.creep, machine.softening) == (twin.share, twin.creep, twin.softening)


def test_the_recordings_cover_what_the_effects_need(case):
    assert len(case.fit_recordings) == 6
    assert [r.name for r in case.holdout_recordings] == ["holdout_stick", "holdout_moves"]
    assert {r.name for r in case.recordings if r.loop == "closed"} == {"moves", "sweep", "holdout_moves"}
    assert case.plant.encoder_step == pytest.approx(Twin().encoder_step / FINER)
    starts = [r.start_time for r in case.recordings]
    assert starts == sorted(starts)
    sliding = {r.name: audit(r, case.plant).regimes.sliding for r in case.recordings}
    assert all(
        sliding[name] == 0.0 for name in ("noise_small", "noise_large", "stick_sines", "holdout_stick")
    )
    assert all(sliding[name] > 0.2 for name in ("moves", "sweep", "holdout_moves"))
    # A load that waits below break-away for half a second or more: creep shows nowhere else.
    u = next(r.u for r in case.recordings if r.name == "breakaway") / Twin().static_voltage
    waits = np.isclose(u, 0.75)
    assert waits.sum() > 0.5 * 2000.0


def test_a_seed_gives_the_same_recordings_and_another_one_others(case):
    again, other = case_of(Twin(), seed=1), case_of(Twin(), seed=2)
    for one, same, new in zip(case.recordings, again.recordings, other.recordings, strict=True):
        assert np.array_equal(one.x, same.x)
        assert not np.array_equal(one.x, new.x)


@pytest.mark.slow
@pytest.mark.parametrize("twin", twins()[1:], ids=lambda twin: twin.name)
def test_diagnose_says_what_the_paper_could_not(twin):
    stages = []
    (found,) = explain([twin], progress=lambda stage, fraction: stages.append(fraction))
    assert found.right, f"{found.named}: {found.diagnosis.summary}"
    assert found.diagnosis.verdict == "named"
    assert stages == sorted(stages)
    if twin.creep:
        parameters = found.diagnosis.missing[0].parameters
        for name, truth in (("compliance", twin.creep), ("time_constant", twin.creep_time)):
            assert abs(parameters[name].value - truth) < 4.0 * parameters[name].stderr
