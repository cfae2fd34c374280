"""The recordings that lie beside the repository, where they do."""

from pathlib import Path

import numpy as np
import pytest

from frictionjax.recordings import audit, load_case

SHARED = Path(__file__).parents[3] / "shared"


def load(*parts):
    path = SHARED.joinpath(*parts, "case.toml")
    if not path.exists():
        pytest.skip("the shared recordings are not here")
    return load_case(path)


def test_emps():
    case = load("real", "emps")
    assert case.plant.motor_constant == 35.1507
    for recording, role in zip(case.recordings, ("fit", "holdout"), strict=True):
        assert (recording.x.size, recording.sample_rate, recording.role) == (24841, 1000.0, role)
        assert recording.loop == "closed" and recording.reference is not None
        assert not recording.sampling.resampled
        found = audit(recording, case.plant)
        assert found.regimes.reversals == 7
        assert found.regimes.sliding > 0.95
        assert not found.clipped["u"].clipped
    train, pulses = (audit(recording, case.plant) for recording in case.recordings)
    assert train.encoder_step == pytest.approx(5e-8, rel=1e-6)
    assert not train.concerns()
    assert "does not lie on the grid" in " ".join(pulses.concerns())


def test_tribometer():
    case = load("real", "tribometer")
    first, second = case.recordings
    assert [r.name for r in case.recordings] == ["test_data_2", "test_data_2_2"]
    assert (first.x.size, second.x.size) == (20000, 20600)
    for recording in case.recordings:
        assert (recording.sample_rate, recording.drive) == (200.0, "motion")
        assert not recording.sampling.resampled and not recording.warnings
        assert not recording.u.any()
        assert recording.force is not None and recording.normal_force is not None
        assert 2.0 < np.abs(recording.force).max() < 3.0
        assert np.ptp(recording.x) == pytest.approx(228e-6, rel=0.05)
        assert np.median(recording.normal_force) == pytest.approx(5.0, rel=0.01)
        regimes = audit(recording, case.plant).regimes
        assert regimes.evidence == "force"
        assert 0.4 < regimes.rest < 0.6 and 0.15 < regimes.presliding < 0.35 and 0.15 < regimes.sliding < 0.35
        assert regimes.reversals in (48, 49, 50)
        assert np.median(regimes.rests) == pytest.approx(0.9, abs=0.15)


def test_motor_bench():
    case = load("real", "motor_bench")
    assert case.plant.motor_constant is None and case.plant.encoder_step is None
    for recording in case.recordings:
        assert (recording.x.size, recording.sample_rate) == (50000, 2500.0)
        assert recording.v is not None
        regimes = audit(recording, case.plant).regimes
        assert regimes.sliding > 0.8
        assert 120 < regimes.reversals / recording.duration < 170


@pytest.mark.parametrize("number", range(1, 9))
def test_sample_cases(number):
    case = load("sample_cases", f"sample_{number}")
    assert len(case.fit_recordings) == 6 and len(case.holdout_recordings) == 2
    assert not any(recording.warnings for recording in case.recordings)
    starts = [recording.start_time for recording in case.recordings]
    assert starts == sorted(starts) and starts[-1] > 200.0
    for recording in case.recordings:
        assert recording.sample_rate == 2000.0
        found = audit(recording, case.plant)
        assert found.encoder_step == pytest.approx(case.plant.encoder_step, rel=1e-4)
        regimes = found.regimes
        if "stick" in recording.name or "noise" in recording.name:
            assert regimes.sliding == 0.0 and regimes.reversals == 0
        if "moves" in recording.name or "sweep" in recording.name:
            assert regimes.sliding > 0.2 and regimes.reversals >= 3
        if "noise" in recording.name:
            assert found.clipped["u"].levels == 2 and not found.clipped["u"].clipped
