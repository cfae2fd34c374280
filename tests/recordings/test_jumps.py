"""Jumps that no machine makes: an angle that wraps is unwrapped, a sensor that stood still is reported."""

import numpy as np
import pytest
from helpers_recordings import HEADER

from frictionjax.core import FrictionjaxWarning
from frictionjax.recordings import Plant, load_case
from frictionjax.recordings.jumps import standing, unwrapped
from frictionjax.recordings.units import turn_of

T = np.arange(3000) / 1000.0
TURNS = {"rad": 2.0 * np.pi, "deg": 360.0, "rev": 1.0}


def moving(speed=0.4):
    """To and fro over several turns of one unit."""
    return 3.0 * np.sin(2.0 * np.pi * speed * T) + 0.5 * T


@pytest.mark.parametrize("unit", TURNS)
@pytest.mark.parametrize("low", [0.0, -0.5], ids=["from zero", "about zero"])
def test_an_angle_that_wraps_is_unwrapped(unit, low):
    turn = TURNS[unit]
    x = turn * moving()
    wrapped = (x - low * turn) % turn + low * turn
    found, count, first = unwrapped(wrapped, unit)
    assert count > 5
    assert abs(wrapped[first] - wrapped[first - 1]) > 0.5 * turn
    np.testing.assert_allclose(np.diff(found), np.diff(x), atol=1e-9 * turn)


@pytest.mark.parametrize("unit", ["rad", "m", "mm", "position", ""])
def test_what_does_not_wrap_stays(unit):
    x = moving()
    found, count, _ = unwrapped(x, unit)
    assert found is x and count == 0


def test_what_is_no_angle_or_too_fast_is_left_alone():
    wrapped = moving() % 1.0
    assert unwrapped(wrapped, "m")[1] == 0
    fast = (np.arange(300) * 0.4) % 1.0
    assert unwrapped(fast, "rev")[1] == 0


@pytest.mark.parametrize(
    ("unit", "turn"),
    [(" Degrees ", 360.0), ("rad", 2 * np.pi), ("mrad", 2e3 * np.pi), ("urad", 2e6 * np.pi), ("rev", 1.0)]
    + [("turn/4096", 4096.0), ("arcsec", 1296000.0), ("°", 360.0)]
    + [(unit, None) for unit in ("mm", "rad/s", "counts", "position", "")],
)
def test_the_turn_of_a_unit(unit, turn):
    found = turn_of(unit)
    assert found == (None if turn is None else pytest.approx(turn, rel=1e-12))
    assert Plant(position_unit=unit).turn == pytest.approx(2 * np.pi if turn is None else turn, rel=1e-12)


def stalled(x, at, length):
    """`x` of a sensor that shows one value for so many samples from each of `at` on."""
    found = x.copy()
    for first in at:
        found[first : first + length + 1] = x[first]
    return found


@pytest.mark.parametrize("length", [6, 25, 60])
@pytest.mark.parametrize("step", [0.0, 1e-5], ids=["smooth", "encoder"])
def test_a_sensor_that_stands_still_and_jumps_is_found(length, step):
    x = moving() + 1e-7 * np.random.default_rng(1).standard_normal(T.size)
    x = step * np.round(x / step) if step else x
    found = standing(stalled(x, (300, 1100, 2200), length))
    assert found is not None
    assert (found.first, found.count, found.longest) == (301 + length, 3, length)


@pytest.mark.parametrize("step", [1e-5, 1e-3, 1e-2])
def test_an_encoder_at_any_speed_does_not_stand_still(step):
    for x in (moving(), 0.02 * T, 0.3 * np.sin(5.0 * T) ** 3):
        assert standing(step * np.round(x / step)) is None


def test_noise_that_repeats_a_value_does_not_stand_still():
    rng = np.random.default_rng(5)
    for _ in range(20):
        x = 6e-6 * np.round(
            0.8 * rng.standard_normal(T.size) + 2.0 * np.maximum(np.cumsum(np.sin(3.0 * T)), 0.0) / 1e3
        )
        assert standing(x) is None


def test_stick_slip_and_moves_with_rests_do_not_stand_still():
    slip = np.floor(5.0 * T) + 0.5 * (1.0 - np.cos(np.pi * np.minimum((5.0 * T) % 1.0 * 20.0, 1.0)))
    assert standing(1e-5 * np.round(slip / 1e-5)) is None
    assert standing(np.zeros(100)) is None


def _file(folder, x, unit):
    rows = [f"{t:.3f},{np.cos(9.0 * t):.6f},{value:.7f}" for t, value in zip(T, x, strict=True)]
    (folder / "run.csv").write_text("\n".join(["t,u,x", *rows]) + "\n")
    part = '[[recording]]\nfile = "run.csv"\n'
    text = f'{HEADER}[plant]\nposition_unit = "{unit}"\n{part}interval = [0.0, 2.0]\n{part}interval = [2.0, 2.9]\n'
    (folder / "case.toml").write_text(text + 'role = "holdout"\n')
    return folder / "case.toml"


def test_the_file_and_the_line_are_named(tmp_path):
    x = TURNS["rad"] * (0.2 + 0.47 * T)
    with pytest.warns(
        FrictionjaxWarning, match=r"x jumps by a full turn once, first at line 1705, column `x`"
    ):
        case = load_case(_file(tmp_path, x % TURNS["rad"], "rad"))
    np.testing.assert_allclose(case.recordings[0].x, x[:2000], atol=1e-6)
    assert any("unwrapped" in text for text in case.recordings[0].warnings)


def test_a_stall_is_reported_with_its_length(tmp_path):
    x = stalled(moving(), (400, 1500), 30)
    with pytest.warns(FrictionjaxWarning, match=r"up to 30 ms and then jumps, 2 times, first at line 433"):
        load_case(_file(tmp_path, x, "rad"))
