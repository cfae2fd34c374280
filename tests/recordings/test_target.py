"""An input that is the target of a position loop is named as such."""

import warnings

import numpy as np
import pytest
from helpers_estimation import PLANT, RATE, closed_loop, moves, open_loop, stick_noise

from frictionjax.recordings import Plant, load_case
from frictionjax.recordings.target import following, said_of_target

RNG = np.random.default_rng(3)


def _servo(late=30):
    """A target, and a position that follows it by a second-order loop and so many samples."""
    t = np.arange(6000) / RATE
    target = 0.4 * np.sin(2.0 * np.pi * 0.7 * t) + 0.1 * np.sin(2.0 * np.pi * 1.9 * t)
    x = np.concatenate([np.zeros(late), target[: t.size - late]])
    return target, x + 1e-4 * RNG.standard_normal(t.size)


def test_a_position_that_follows_its_target_is_found_with_its_lag():
    target, x = _servo()
    found = following(x, target, RATE)
    assert found is not None and found.late == pytest.approx(30 / RATE, abs=1.5 / RATE)
    assert found.slope == pytest.approx(1.0, abs=0.01) and found.left < 0.01
    assert following(x, 0.5 * target, RATE) is None and following(x, -target, RATE) is None
    assert following(x, np.zeros_like(x), RATE) is None


@pytest.mark.parametrize(
    ("late", "slope", "noise", "follows"),
    [
        (30, 1.015, 0.0, True),
        (30, 1.025, 0.0, False),
        (30, 1.0, 0.07, True),
        (30, 1.0, 0.13, False),
        (900, 1.0, 0.0, True),
        (1015, 1.0, 0.0, False),
    ],
)
def test_it_must_come_as_far_and_soon(late, slope, noise, follows):
    target, x = _servo(late)
    x = slope * x + noise * np.std(x) * RNG.standard_normal(x.size)
    assert (following(x, target, RATE) is not None) == follows


def test_a_target_that_does_not_move_where_it_could_be_followed_says_nothing():
    u, x = np.zeros(400), np.zeros(400)
    u[-1], x[-1] = 1.0, 2.0
    assert following(x, u, 100.0) is None


@pytest.mark.parametrize("unit", ["deg", "rad", "input"])
def test_units_are_the_same_for_both(unit):
    target, x = _servo()
    shown = np.degrees(target) if unit == "deg" else target
    said = said_of_target(x, shown, RATE, Plant(position_unit="rad", input_unit=unit))
    assert said.startswith("x follows u 15 ms later") and "name this column reference" in said
    alike = said_of_target(x, shown, RATE, Plant(position_unit="mm", input_unit="mm"))
    assert bool(alike) == (unit != "deg")


def test_what_drives_a_machine_is_no_target():
    """Neither the torque of a machine that slides, nor that which bends the bristles of one in stick."""
    for recording in (
        closed_loop("moves", moves(4.0), seed=1),
        open_loop("stick", stick_noise(2.0, seed=2), seed=2),
        open_loop("pushes", 2.0 * np.sin(2.0 * np.pi * np.arange(8000) / RATE), seed=3, drive=PLANT),
    ):
        assert following(recording.x, recording.u, RATE) is None


def test_it_is_said_when_the_file_is_read(tmp_path):
    target, x = _servo()
    rows = np.column_stack([np.arange(x.size) / RATE, target, x])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,u,x", comments="")
    (tmp_path / "case.toml").write_text('[[recording]]\nfile = "run.csv"\n')
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        case = load_case(tmp_path / "case.toml")
    assert any("run.csv: x follows u 15 ms later" in str(one.message) for one in caught)
    assert any("x follows u" in text for text in case.recordings[0].warnings)
