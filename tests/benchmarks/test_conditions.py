"""What the conditions of `benchmarks.conditions` make of a machine's recordings; the diagnoses themselves are slow."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("numba")

from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from benchmarks.conditions import CONDITIONS, SEED
from frictionjax.core import FrictionjaxWarning


@pytest.fixture(scope="module")
def short():
    return case_of(make_case(SEED, missing=(), strength="strong", kind="rotary", stretch=0.1))


@pytest.mark.parametrize(
    ("name", "rate"), [("500 Hz of a loop of 2 kHz", 500.0), ("200 Hz of a loop of 2 kHz", 200.0)]
)
def test_a_slower_recorder_keeps_times_and_mean_input(short, name, rate):
    slow = CONDITIONS[name].change(short)
    for before, after in zip(short.recordings, slow.recordings, strict=True):
        by = round(before.sample_rate / rate)
        assert after.sample_rate == rate and after.x.size == after.u.size == before.x.size // by
        np.testing.assert_array_equal(after.x, before.x[: after.x.size * by : by])
        held = before.u[: after.u.size * by].mean()
        np.testing.assert_allclose(after.u.mean(), held, rtol=1e-12, atol=1e-15)


def test_rates_are_mixed(short):
    mixed = CONDITIONS["rates of 2000, 1000 and 500 Hz"].change(short)
    assert {r.sample_rate for r in mixed.recordings} == {2000.0, 1000.0, 500.0}


def test_a_coarse_encoder_tells_its_step(short):
    coarse = CONDITIONS["encoder of 12 bit"].change(short)
    step = 2.0 * np.pi / 4096
    assert coarse.plant.encoder_step == step
    counts = coarse.recordings[-1].x / step
    np.testing.assert_allclose(counts, np.round(counts), rtol=0, atol=1e-6)


def test_uneven_stamps_are_made_even_as_any_file_is(short):
    with pytest.warns(FrictionjaxWarning, match="deviate from uniform steps by up to 0.4"):
        uneven = CONDITIONS["2 kHz, steps that differ by two fifths"].change(short)
    for before, after in zip(short.recordings, uneven.recordings, strict=True):
        assert after.name == before.name and after.role == before.role
        np.testing.assert_allclose(after.sample_rate, before.sample_rate / 5.0, rtol=0.01)
        travel = np.ptp(before.x)
        at = np.arange(after.x.size) / after.sample_rate + 5.0 / before.sample_rate
        there = np.interp(at, np.arange(before.x.size) / before.sample_rate, before.x)
        assert np.abs(after.x - there)[5:-5].max() < 0.02 * travel


def test_what_is_left_out(short):
    assert CONDITIONS["motor constant unknown"].change(short).plant.motor_constant is None
    with pytest.warns(FrictionjaxWarning, match="the last third"):
        one = CONDITIONS["one recording"].change(short)
    assert [(r.name, r.role) for r in one.recordings] == [("moves", "fit"), ("moves_last_third", "holdout")]


@pytest.mark.filterwarnings("ignore:.*deviate from uniform steps", "ignore:.*the last third")
def test_every_condition_can_be_simulated():
    for condition in CONDITIONS.values():
        options = {**condition.options, "stretch": 0.1}
        simulated = make_case(
            SEED, missing=("direction_asymmetry",), strength="strong", kind="rotary", **options
        )
        assert condition.change(case_of(simulated)).recordings


@pytest.mark.slow
def test_the_command_prints_a_row():
    command = [sys.executable, "-m", "benchmarks.conditions", "--only", "ten seconds in all"]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert told[0].startswith("| condition") and told[2].startswith("| ten seconds in all | adequate")
    assert "direction_asymmetry" in told[2]
