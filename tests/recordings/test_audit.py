"""The audit, on signals whose truth is known."""

import json

import numpy as np
import pytest

from frictionjax.recordings import Plant, Recording, audit, load_case
from frictionjax.recordings.regimes import find_regimes, turning_points
from frictionjax.recordings.signals import clipping, noise_std, on_grid, processing, quantum

RATE = 1000.0
RNG = np.random.default_rng(11)


@pytest.fixture(autouse=True)
def same_noise_in_every_order():
    RNG.bit_generator.state = np.random.default_rng(11).bit_generator.state


def stroke(length, seconds):
    """A smooth move of `length` in `seconds`, from rest to rest, in position units, starting from 0."""
    s = np.linspace(0.0, 1.0, round(seconds * RATE))
    return length * (10 * s**3 - 15 * s**4 + 6 * s**5)


def chain(*parts):
    """Parts of a motion, each starting where the one before ended."""
    placed, end = [], 0.0
    for part in parts:
        placed.append(end + part)
        end = placed[-1][-1]
    return np.concatenate(placed)


def rest(seconds):
    return np.zeros(round(seconds * RATE))


def wiggle(amplitude, seconds, frequency=4.0):
    return amplitude * np.sin(2.0 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE)


def measured(x, step=1e-7, noise=0.5e-7):
    return step * np.rint((x + noise * RNG.normal(size=x.size)) / step)


def recording(x, u=None, **fields):
    u = RNG.normal(size=x.size) if u is None else u
    return Recording(name="run", sample_rate=RATE, u=u, x=x, **fields)


@pytest.mark.parametrize("size", [1e-8, 1e-3])
def test_noise_is_read_from_a_moving_signal(size):
    x = chain(stroke(0.1, 5.0), stroke(-0.1, 5.0)) + size * RNG.normal(size=10000)
    assert noise_std(x) == pytest.approx(size, rel=0.05)


@pytest.mark.parametrize("step", [1e-7, 1.69835213e-6, 0.36, 3.0])
@pytest.mark.parametrize("digits", [9, 17])
def test_the_quantum_is_found(step, digits):
    x = step * np.rint(1000.0 * wiggle(1.0, 4.0, 1.0) + RNG.normal(size=4000))
    x = np.array([float(f"{v:.{digits}g}") for v in x])
    assert quantum(x) == pytest.approx(step, rel=1e-5)
    assert on_grid(x, step) > 0.999
    assert on_grid(x, 1.37 * step) < 0.5


def test_the_quantum_of_a_motion_that_never_moves_by_one():
    assert quantum(2e-6 * np.rint(stroke(5.0, 1.0)[100:900] / 2e-6)) == pytest.approx(2e-6, rel=1e-4)


def test_no_quantum_where_there_is_no_grid():
    assert quantum(wiggle(1.0, 4.0, 1.0) + 1e-6 * RNG.normal(size=4000)) is None
    assert quantum(np.zeros(500)) is None
    assert quantum(np.arange(500.0)) == pytest.approx(1.0)


def test_few_levels_are_not_clipping():
    prbs = np.repeat(RNG.choice([-1.0, 1.0], 500), 8)
    square = np.sign(wiggle(1.0, 4.0, 2.3))
    stairs = np.repeat(np.arange(10.0), 100)
    for u in (prbs, square, stairs):
        assert not clipping(u).clipped
    assert clipping(prbs).levels == 2


def test_smooth_inputs_are_not_clipping():
    ramp_and_hold = np.clip(wiggle(2.0, 1.0, 0.5), None, 1.0)
    for u in (wiggle(1.0, 4.0), RNG.normal(size=4000), ramp_and_hold):
        assert not clipping(u).clipped


def test_a_saturated_input_is_clipping():
    for u in (
        np.clip(wiggle(1.0, 4.0), -0.8, 0.8),
        np.clip(np.cumsum(RNG.normal(size=4000)) / 20.0, -1.0, 1.0),
    ):
        found = clipping(u)
        assert found.clipped and found.levels == 17
    found = clipping(np.clip(wiggle(1.0, 4.0), None, 0.5))
    assert found.clipped and found.high == pytest.approx(1.0 / 3.0, abs=0.01) and found.low < 0.01


def test_traces_of_processing():
    x = chain(stroke(0.1, 2.0), stroke(-0.1, 2.0))
    noisy = x + 1e-6 * RNG.normal(size=x.size)
    coarse = np.arange(0, x.size, 4)
    assert processing(noisy, None) == ""
    grid = measured(x)
    assert processing(grid, quantum(grid)) == ""
    held = np.repeat(grid[coarse], 4)
    assert processing(held, quantum(held)) == "held"
    assert processing(np.interp(np.arange(x.size), coarse, noisy[coarse]), None) == "interpolated"
    assert (
        processing(np.convolve(noisy, np.hanning(22) / np.hanning(22).sum(), mode="same")[20:-20], None)
        == "smooth"
    )


def test_turning_points():
    x = chain(stroke(1.0, 1.0), stroke(-2.0, 1.0), stroke(0.5, 1.0)) + 1e-3 * RNG.normal(size=3000)
    np.testing.assert_allclose(turning_points(x, 8e-3), [0, 1000, 2000, 2999], atol=120)
    np.testing.assert_array_equal(turning_points(np.zeros(50), 1.0), [0, 49])


def test_a_recording_through_break_away_visits_all_regimes():
    x = chain(
        rest(1.0),
        wiggle(2e-5, 2.0),
        rest(0.5),
        stroke(0.05, 1.0),
        stroke(-0.05, 1.0),
        stroke(0.03, 1.0),
        rest(1.5),
    )
    found = audit(recording(measured(x)), Plant(position_unit="m")).regimes
    assert found.evidence == "two travels"
    assert found.gross_travel is not None and 4e-5 < found.gross_travel < 0.03
    assert (len(found.rests), found.reversals) == (3, 2)
    np.testing.assert_allclose(found.rests, [1.0, 0.5, 1.5], atol=0.15)
    assert found.rest == pytest.approx(3.0 / 8.0, abs=0.03)
    assert found.sliding == pytest.approx(2.6 / 8.0, abs=0.08)
    assert found.rest + found.presliding + found.sliding == pytest.approx(1.0)
    assert found.speed is not None and found.speed[1] == pytest.approx(0.09, rel=0.15)


def test_a_recording_of_one_regime():
    plant = Plant()
    small = audit(recording(measured(wiggle(2e-5, 4.0))), plant).regimes
    assert (small.presliding, small.sliding, small.reversals, small.speed) == (1.0, 0.0, 0, None)
    large = audit(recording(measured(wiggle(0.05, 4.0))), plant).regimes
    assert large.sliding > 0.95 and large.reversals == pytest.approx(31, abs=1)
    still = audit(recording(measured(rest(4.0))), plant)
    assert still.regimes.rest > 0.99 and still.regimes.sliding == 0.0
    assert "at rest for more than 99 %" in " ".join(still.concerns())


@pytest.mark.parametrize(
    ("unit", "stroke", "slides"),
    [
        ("rad", 0.06, True),
        ("rad", 0.04, False),
        ("deg", 3.5, True),
        ("mm", 6.0, True),
        ("mm", 4.0, False),
        ("V", 60.0, False),
    ],
)
def test_a_machine_with_a_coarse_sensor_slides(unit, stroke, slides):
    """A joint that turns by a radian does, though its encoder has few steps; of a voltage nobody knows."""
    step = 2.0 * stroke / 3000.0
    x = step * np.rint(wiggle(stroke, 4.0) / step)
    found = audit(recording(x), Plant(position_unit=unit)).regimes
    assert found.evidence == "size"
    assert (found.sliding > 0.9) == slides and (found.sliding == 0.0) != slides


def test_the_gross_travel_may_be_given():
    x = measured(wiggle(2e-5, 4.0))
    found = audit(recording(x), Plant(), gross_travel=1e-5).regimes
    assert found.evidence == "given" and found.sliding > 0.5


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_measured_force_tells_sliding(sense):
    ramps = [np.linspace(0.0, s * 2e-4, 1000) for s in (1, -1) * 4]
    x = chain(*ramps)
    force = [np.clip(s * (np.linspace(0.0, 4.0, 1000) - 1.0), -1.0, 1.0) for s in (1, -1) * 4]
    force = sense * (np.concatenate(force) + 0.01 * RNG.normal(size=x.size))
    found = find_regimes(measured(x), RATE, 0.5e-7, force=force)
    assert (found.evidence, found.reversals) == ("force", 7)
    assert found.sliding == pytest.approx(1.0 - 1.8 / 4.0, abs=0.03)
    assert found.speed is not None and found.speed[0] == pytest.approx(2e-4, rel=0.2)


def test_the_encoder_step_is_compared():
    x = measured(wiggle(2e-4, 4.0))
    assert not audit(recording(x), Plant(encoder_step=1.00001e-7)).concerns()
    assert not audit(recording(x), Plant()).concerns()
    twice = audit(recording(2.0 * x), Plant(encoder_step=1e-7, position_unit="m")).concerns()
    assert len(twice) == 1 and "grid of 2e-07 m, 2 times the encoder step" in twice[0]
    off = audit(recording(x + 1e-7 * RNG.normal(size=x.size)), Plant(encoder_step=1e-7)).concerns()
    assert len(off) == 1 and "does not lie on the grid" in off[0]


def test_values_that_are_not_finite_are_counted_and_bridged():
    x = measured(wiggle(2e-4, 4.0))
    spoiled = x.copy()
    spoiled[[10, 500, 501]] = [np.nan, np.inf, np.nan]
    found = audit(recording(spoiled, v=np.full(x.size, np.nan)), Plant())
    assert found.not_finite == {"x": 3, "v": x.size}
    assert found.noise_std == pytest.approx(noise_std(x), rel=0.05)
    assert "x has 3 values that are not a number" in found.concerns()[0]


def test_constant_and_clipped_channels_are_reported():
    x = measured(wiggle(2e-4, 4.0))
    found = audit(
        recording(x, np.clip(wiggle(1.0, 4.0), -0.5, 0.5), temperature=np.full(x.size, 20.0)), Plant()
    )
    assert found.constant == ("temperature",)
    text = " ".join(found.concerns())
    assert "temperature never changes." in text and "u looks clipped" in text


def test_sentences_and_json():
    x = measured(chain(rest(1.0), wiggle(2e-5, 2.0), stroke(0.05, 1.0)))
    found = audit(recording(x), Plant(position_unit="m", encoder_step=1e-7))
    sentences = found.sentences()
    assert all(s.endswith(".") and "\n" not in s for s in sentences)
    assert "4000 samples at 1000 Hz, 4 s." in sentences
    assert "grid of 1e-07 m" in sentences[1] and "1 rest " in sentences[2]
    as_json = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert as_json["samples"] == 4000 and as_json["regimes"]["evidence"] == "two travels"
    nothing = audit(recording(measured(wiggle(2e-5, 2.0))), Plant())
    assert nothing.to_json()["regimes"]["gross_travel"] is None


def test_what_matters_stands_in_the_warnings_of_the_recording(tmp_path):
    t = np.arange(2000) / RATE
    for name, offset in (("run", 0.0), ("kept", 1.0)):
        rows = np.stack(
            [t, np.clip(wiggle(1.0, 2.0), -0.5, 0.5), measured(wiggle(2e-4, 2.0)) + offset], axis=1
        )
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,u,x", comments="", fmt="%.9g")
    recordings = '[[recording]]\nfile = "run.csv"\n[[recording]]\nfile = "kept.csv"\nrole = "holdout"\n'
    (tmp_path / "case.toml").write_text(recordings)
    assert [
        "u looks clipped" in " ".join(r.warnings) for r in load_case(tmp_path / "case.toml").recordings
    ] == [True] * 2
