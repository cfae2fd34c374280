"""`diagnose` from end to end: small cases here, whole ones in the slow tests."""

import dataclasses
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import numpy as np
import pytest
from helpers_estimation import PLANT, small_case, truth

import frictionjax.api
from frictionjax.core import PrecisionError
from frictionjax.demo import write_demo_case
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.screening import try_catalogue
from frictionjax.physics import catalogue
from frictionjax.recordings import Controller, load_case

SHARED = Path(__file__).parents[3] / "shared"
"""Cases that are kept beside the repository, where there are any."""
FEW = ("delay",)
LATE = 2
"""Samples by which the input acts late in the small case: a delay of 1 ms."""


SERVO = Controller(kp=7.4, kd=0.165)
"""Nearly that of the recordings in closed loop."""


def _few(monkeypatch):
    """One effect in place of the whole catalogue: a small case costs little but the compilation of each."""
    names = {name: catalogue()[name][:1] for name in FEW}
    monkeypatch.setattr(try_catalogue, "catalogue", lambda: names)


@pytest.fixture(scope="module")
def stated():
    """What a diagnosis stated of its progress."""
    return []


@pytest.fixture(scope="module")
def late(stated):
    """The small case with an input that acts 1 ms late."""
    with pytest.MonkeyPatch.context() as monkeypatch, ThreadPoolExecutor(2) as executor:
        _few(monkeypatch)
        return diagnose(
            dataclasses.replace(small_case(late=LATE), controller=SERVO),
            executor=executor,
            progress=lambda stage, done: stated.append((stage, done)),
        )


def test_a_hidden_delay_is_named(late):
    assert late.verdict == "named"
    (missing,) = late.missing
    assert missing.effect == "delay"
    assert missing.effect_class == ("delay",)
    found = missing.parameters["delay"]
    assert found.unit == "s"
    assert found.value == pytest.approx(1e-3, abs=max(5.0 * found.stderr, 1e-5))
    assert missing.p_value < 1e-3
    assert missing.confidence > 0.8
    assert not late.unexplained.present
    assert late.summary.startswith(
        "Missing from the base model: a pure delay between input and force. The mismatch is in: "
    )


def test_the_base_is_mended_with_the_delay(late):
    extended = {name: estimate.value for name, estimate in late.extended.items()}
    for name, value in truth(PLANT).items():
        assert extended[name] == pytest.approx(value, rel=0.01), name
    assert set(late.extended) == {*late.base, "delay"}


def test_under_the_controller_the_error_falls_as_well(late):
    for fit in late.recordings:
        if fit.closed_loop is None:
            assert fit.role == "fit"
        else:
            assert fit.closed_loop.extended < 0.2 * fit.closed_loop.base
            assert fit.closed_loop.given is None and fit.closed_loop.law is None
    assert any(fit.closed_loop is not None and fit.role == "holdout" for fit in late.recordings)


def test_the_held_out_error_falls_to_the_noise(late):
    (held,) = [fit for fit in late.recordings if fit.role == "holdout"]
    assert held.prediction_rmse_base > 2.0 * held.prediction_rmse_extended
    assert held.prediction_rmse_extended < 10.0 * held.noise_floor
    assert [fit.name for fit in late.recordings] == ["stick", "ramps", "loud", "moves", "others"]


def test_every_effect_has_a_row(late):
    rows = {row.effect: row for row in late.candidates}
    assert set(rows) == set(catalogue())
    assert {name for name, row in rows.items() if row.tested} == set(FEW)
    assert rows["delay"].reason == "named"
    assert rows["delay"].gain_fit > 0.9
    assert rows["delay"].gain_holdout > 0.8


def test_the_map_tells_what_the_extension_mends(late):
    for axis in ("regime", "time", "direction", "frequency"):
        assert sum(b.share for b in late.mismatch if b.axis == axis) == pytest.approx(1.0)
    before = sum(b.count * b.excess for b in late.mismatch if b.axis == "time")
    after = sum(b.count * b.excess_extended for b in late.mismatch if b.axis == "time")
    assert after < 0.5 * before
    assert after / sum(b.count for b in late.mismatch if b.axis == "time") == pytest.approx(1.0, abs=0.2)


def test_progress_and_times_are_reported(late, stated):
    done = [fraction for _, fraction in stated]
    assert done == sorted(done)
    assert (done[0], done[-1]) == (0.0, pytest.approx(0.95, abs=0.05))
    assert any("testing every effect" in stage for stage, _ in stated)
    assert set(late.seconds) >= {"start", "base fit", "naming", "judging", "compile", "total"}
    stages = sum(value for name, value in late.seconds.items() if name not in ("total", "compile"))
    assert stages == pytest.approx(late.seconds["total"], abs=0.1)


def test_the_diagnosis_is_saved_with_its_report(late, tmp_path):
    assert frictionjax.api.diagnose is diagnose  # the import registers the report's writer
    folder = late.save(tmp_path / "out")
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["schema"] == "frictionjax.verdict/1"
    assert verdict["verdict"] == "named"
    assert verdict["missing"][0]["effect"] == "delay"
    assert "delay" in verdict["extended"]["parameters"]
    assert (folder / "report.html").stat().st_size > 10_000
    columns = np.genfromtxt(folder / "fit" / "others.csv", delimiter=",", names=True)
    recorded = small_case(late=LATE).holdout_recordings[0]
    np.testing.assert_allclose(columns["x"], recorded.x, atol=1e-9)


@pytest.mark.slow
def test_its_null_twin_is_adequate(monkeypatch):
    _few(monkeypatch)
    found = diagnose(small_case())
    assert found.verdict == "adequate"
    assert found.missing == ()
    assert found.summary == (
        "Nothing significant is missing: the base model leaves no misfit that is significant above the noise."
    )
    assert found.base == found.extended
    for name, value in truth(PLANT).items():
        assert found.base[name].value == pytest.approx(value, rel=0.01), name


def test_float32_is_refused():
    case = small_case()
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="jax_enable_x64"):
        diagnose(case)


@pytest.mark.slow
def test_the_whole_catalogue_names_the_delay_alone():
    found = diagnose(small_case(late=LATE))
    assert found.verdict == "named"
    assert [effect.effect for effect in found.missing] == ["delay"]


@pytest.mark.slow
def test_ten_seconds_are_enough_for_a_delay():
    """The delay explains all of the misfit: that few clusters show it must not hide it."""
    found = diagnose(small_case(late=LATE, seconds=2.5))
    assert [effect.effect for effect in found.missing] == ["delay"]


@pytest.mark.slow
def test_the_demo_without_anything_missing_is_adequate(tmp_path):
    found = diagnose(load_case(write_demo_case(tmp_path, base=True)))
    assert found.verdict == "adequate"
    assert found.missing == ()


@pytest.mark.slow
def test_the_demo_is_maxwell_slip(tmp_path):
    found = diagnose(load_case(write_demo_case(tmp_path)))
    assert found.verdict == "named"
    assert found.missing[0].effect == "maxwell_slip"
    held = {fit.name: fit for fit in found.recordings if fit.role == "holdout"}
    stick = held["holdout_stick"]
    assert stick.prediction_rmse_base > 5.0 * stick.prediction_rmse_extended


SAMPLES = sorted(SHARED.glob("sample_cases/sample_*"))


@pytest.mark.slow
@pytest.mark.skipif(not SAMPLES, reason="the sample cases are not beside the repository")
@pytest.mark.parametrize("folder", SAMPLES, ids=lambda folder: folder.name)
def test_a_sample_case_is_named_rightly_or_not_at_all(folder):
    missing = json.loads((SHARED / "sample_cases" / "truth.json").read_text())[folder.name]["missing"]
    found = diagnose(load_case(folder / "case.toml"))
    names = [effect.effect for effect in found.missing]
    if not missing:
        assert (found.verdict, names) == ("adequate", [])
    elif missing[0] in catalogue():
        assert found.verdict == "named"
        assert names[:1] == missing
    else:
        assert found.verdict == "unknown"
        assert names == []


@pytest.mark.slow
@pytest.mark.skipif(not (SHARED / "real" / "emps").exists(), reason="the data are not beside the repository")
def test_emps_has_its_published_mass_and_an_offset():
    """Janot, Gautier, Brunot (2019): M = 95.1 kg, a constant offset of -3.2 N, friction that differs by direction."""
    found = diagnose(load_case(SHARED / "real" / "emps" / "case.toml"))
    masses = [table["J"].value for table in (found.base, found.extended)]
    assert min(abs(mass / 95.1 - 1.0) for mass in masses) < 0.02
    named = {name for effect in found.missing for name in effect.effect_class}
    assert named & {"direction_asymmetry", "constant_load"}
