"""The map: a planted error is found in its bin and put in words, and noise alone is found nowhere."""

import numpy as np
import pytest
from helpers_estimation import RATE
from helpers_locate import World, moves, swings, views_of

from frictionjax.diagnosis.mismatch_map.axes import MapAxis
from frictionjax.diagnosis.mismatch_map.conditions import parts_within
from frictionjax.diagnosis.mismatch_map.null_maps import Chance
from frictionjax.diagnosis.mismatch_map.where_words import lead_of, strongest, where_words
from frictionjax.diagnosis.verdict import MismatchBin, Within

AXES = (
    "regime",
    "direction",
    "velocity",
    "position",
    "input",
    "since_reversal",
    "dwell",
    "time",
    "frequency",
)


@pytest.fixture(scope="module")
def world():
    return swings()


@pytest.fixture(scope="module")
def stops():
    """A machine that moves and rests; the time since each motion began, and the rest before it."""
    return moves()


def _labels(bins, axis):
    return [b.bin for b in bins if b.axis == axis]


def test_every_axis_is_there_and_its_shares_add_to_one(world):
    e = world.innovations(0) * (1.0 + 0.3 * np.sin(2.0 * np.pi * 0.3 * world.t))
    bins = world.located(e).bins
    assert {b.axis for b in bins} == set(AXES)
    for axis in AXES:
        assert sum(b.share for b in bins if b.axis == axis) == pytest.approx(1.0)
        assert all(0.0 <= b.share <= 1.0 for b in bins if b.axis == axis)
    assert all(np.isfinite(b.excess) and b.count > 0 and 0.0 < b.p_value <= 1.0 for b in bins)


def test_bins_of_an_axis_hold_every_sample_once(world, stops):
    for one in (world, stops[0]):
        for axis in one.axes:
            inside = axis.index[np.asarray(one.scene.batch.valid) > 0]
            assert inside.min() >= 0, axis.name
            assert inside.max() < len(axis.labels) == len(axis.phrases), axis.name


PLANTED = {
    "direction": ("backward", lambda w: w.motion.v < -0.05),
    "position": ("x 0.05 to 0.1 rad", lambda w: (w.motion.x > 0.05) & (w.motion.x < 0.1)),
    "time": (
        "two from 2.67 to 5.33 s",
        lambda w: (w.t > 2.67) & (w.t < 5.33) & (np.arange(2)[:, None] == 1),
    ),
    "regime": ("sliding", lambda w: np.abs(w.motion.v) > 0.3),
    "input": ("|u| above 0.0481 V", lambda w: np.abs(w.motion.u) > 0.0481),
}


def test_each_effect_is_located_by_the_errors_that_it_explains(world):
    """Two errors in two places: whichever is explained first, each effect has the place of its own errors."""
    places, true = [PLANTED[axis] for axis in ("direction", "position")], world.innovations(0)
    errors = [8.0 * where(world) * world.innovations(1 + k) for k, (_, where) in enumerate(places)]
    grid = world.grid()
    for first, second in ((0, 1), (1, 0)):
        base, between, final = views_of(true + errors[0] + errors[1], true + errors[second], true)
        explained = grid.explained(base, between), grid.explained(between, final)
        for number, text in zip((first, second), explained, strict=True):
            own, other = (places[k][0].removeprefix("x ") for k in (number, 1 - number))
            assert own in text and "of what it explains" in text
            assert other not in text
        assert grid.explained(final, final) == "no place stands out"


@pytest.mark.parametrize("axis", PLANTED)
def test_a_planted_error_is_found_in_its_bin(world, axis):
    label, where = PLANTED[axis]
    e = world.innovations(0)
    bins = world.located(e + 8.0 * where(world) * world.innovations(1), after=e).bins
    found = strongest(bins, axis)
    assert found is not None
    assert found.bin == label
    assert found.share > 0.8
    assert found.excess > 10.0
    assert found.excess_extended == pytest.approx(1.0, abs=0.15)
    assert found.p_value == pytest.approx(1.0 / 200.0)


def test_an_error_after_reversals_is_found_there(world):
    turned = np.diff(np.sign(world.motion.v), axis=1, prepend=np.sign(world.motion.v[:, :1])) != 0
    after = np.stack(
        [
            np.convolve(row, np.ones(150), "full")[: row.size] > 0
            for row in np.roll(turned, round(0.0225 * RATE), axis=1)
        ]
    )
    found = strongest(world.planted(after).bins, "since_reversal")
    assert found is not None
    assert found.bin == "20 to 100 ms after a reversal"
    assert found.share > 0.8


def test_a_distance_is_reported_where_it_tells_more_than_a_time(stops):
    """Motions of many speeds, an error in the first 2 mrad of each: the time that takes differs."""
    world, age, _ = stops
    turn = np.where(np.isfinite(age) & (age < 1.0 / RATE), np.arange(world.t.size), 0)
    start = np.maximum.accumulate(turn, axis=1)
    way = np.abs(world.motion.x - np.take_along_axis(world.motion.x, start, axis=1))
    found = world.planted((way < 2e-3) & np.isfinite(age))
    assert "more than 0.02 rad after a reversal" in _labels(found.bins, "since_reversal")
    assert "first 2 mrad after a reversal" in found.where
    shares = [b.share for b in found.bins if b.axis == "since_reversal"]
    assert sum(shares) == pytest.approx(1.0)


def test_an_error_of_one_frequency_is_found_in_its_band(world):
    bins = world.located(world.innovations(0) + 3.0 * np.sin(2.0 * np.pi * 33.0 * world.t)).bins
    found = strongest(bins, "frequency")
    assert found is not None
    assert found.bin == "20 to 50 Hz"
    assert found.share > 0.9


def test_noise_stands_out_in_no_band(world):
    """The observer leaves next to nothing at low frequencies: what leaks there must not look like a finding."""
    bands = [b for b in world.located(world.innovations(0)).bins if b.axis == "frequency"]
    assert {b.bin: b.excess for b in bands if b.excess > 1.5} == {}


def _false_maps(world, floor, chance, repetitions):
    """Part of true models' maps with a significant bin, and which said a place in words."""
    maps = [
        world.located(world.innovations(1000 + k, floor), floor=floor, chance=chance)
        for k in range(repetitions)
    ]
    said = [found.where for found in maps if found.where != "nowhere above the noise"]
    return np.mean([min(b.p_value for b in found.bins) < 0.05 for found in maps]), said


@pytest.mark.parametrize(
    ("repetitions", "floored"),
    [
        (60, False),
        pytest.param(400, False, marks=pytest.mark.slow),
        pytest.param(400, True, marks=pytest.mark.slow),
    ],
)
def test_one_map_in_twenty_of_noise_has_a_significant_bin(world, repetitions, floored):
    """Over all bins of all axes; with an unmeasured force too. Rarer still is a place put in words."""
    blocks = np.asarray(world.scene.batch.block_count).shape
    floor = 1.0 + 3.0 * np.random.default_rng(5).random(blocks) if floored else None
    chance = world.chance_above(floor) if floored else world.chance
    false, said = _false_maps(world, floor, chance, repetitions)
    # Of the repetitions, and of the draws that the level stands on.
    error = np.sqrt(0.05 * 0.95 * (1.0 / repetitions + 1.0 / chance.largest.size))
    assert abs(false - 0.05) < 2.5 * error
    assert len(said) <= 0.05 * repetitions


def test_the_level_of_a_map_is_that_of_its_largest_bin():
    chance = Chance(np.ones(3), np.linspace(0.0, 4.0, 199))
    p_values = chance.p_values(np.array([-1.0, 2.0, 9.0]))
    assert p_values == pytest.approx([1.0, 0.505, 0.005])


def test_an_error_that_is_everywhere_is_reported(world):
    found = world.planted(np.ones(world.motion.x.shape), size=3.0)
    assert found.where.startswith("every regime (10 times the expected power)")
    assert found.within == ()
    assert max(b.p_value for b in found.bins if b.axis == "direction") < 0.05


def test_a_short_burst_is_no_chance(world):
    """One cluster of many: its scatter is as large as its mean, and still it is seen."""
    burst = (world.t > 3.0) & (world.t < 3.1) & (np.arange(2)[:, None] == 0)
    found = strongest(world.planted(burst).bins, "time")
    assert found is not None
    assert found.bin == "one from 2.67 to 5.33 s"


def test_an_error_after_long_rests_is_reported_as_such(stops):
    world, age, rest = stops
    found = world.planted((age < 0.05) & (rest > 0.3))
    (dwell,) = (part for part in found.within if part.axis == "dwell")
    assert dwell.only
    assert dwell.bin == "after rests longer than 0.3 s"
    assert dwell.p_value < 1e-6
    assert dwell.excess_elsewhere == pytest.approx(1.0, abs=0.1)
    assert "first 0.01 rad after a reversal" in found.where
    assert found.where.endswith("only after rests longer than 0.3 s (100 %)")
    bins = {b.bin: b for b in found.bins if b.axis == "dwell"}
    assert bins["after rests of 0.3 to 1 s"].p_value < 0.05
    assert bins["after rests of 0.1 to 0.3 s"].p_value >= 0.05


def test_an_error_at_one_place_in_one_direction_is_reported_as_such(world):
    found = world.planted((world.motion.x > 0.05) & (world.motion.x < 0.1) & (world.motion.v < 0.0))
    assert "x 0.05 to 0.1 rad (100 % of the excess" in found.where
    assert found.where.endswith("only moving backward (100 %)")


def test_an_error_in_every_motion_is_not_reported_of_a_part(stops):
    """Motions whose errors differ by chance alone: none of the parts compared holds more, but for one map in twenty."""
    world, age, _ = stops
    event = np.cumsum(np.diff(np.isfinite(age), axis=1, prepend=False), axis=1)
    lead = tuple(_bin("regime", label, 0.5, 10.0) for label in ("slow sliding (Stribeck)", "sliding"))
    rng, false = np.random.default_rng(3), 0
    for k in range(40):
        size = rng.lognormal(1.0, 0.8, (2, int(event.max()) + 1))
        own = np.take_along_axis(size, event, axis=1) * np.isfinite(age)
        power = (world.innovations(k) + own * world.innovations(k + 500)) ** 2
        false += parts_within(lead, world.axes, power, world.scene) != ()
    assert false <= 0.05 * 40 + 2.0 * np.sqrt(0.05 * 0.95 * 40)


def test_a_bin_with_few_samples_is_left_out(world):
    index = np.ones(world.motion.x.shape, int)
    index[0, 1000:1100] = 0
    few = World.__new__(World)
    few.__dict__.update(world.__dict__)
    few.axes = (MapAxis("regime", ("few", "most"), ("in few", "in most"), index),)
    few.chance = few.chance_above(None)
    assert _labels(few.located(few.innovations(0)).bins, "regime") == ["most"]


def test_not_finite_innovations_leave_a_finite_map(world):
    e = world.innovations(0)
    e[0, 5000:5100] = np.nan
    assert all(np.isfinite(b.share) and np.isfinite(b.excess) for b in world.located(e).bins)


def _bin(axis, label, share, excess, *, p_value=float("nan"), count=1000):
    return MismatchBin(axis, label, share, excess, 1.0, count, p_value)


def test_where_is_reported_in_words():
    bins = (
        _bin("regime", "sliding", 0.9, 12.34),
        _bin("regime", "stick", 0.1, 1.3),
        _bin("position", "x 0 to 0.1 rad", 0.95, 30.0),
        _bin("position", "x 0.1 to 0.2 rad", 0.05, 1.3, count=9000),
    )
    part = Within("direction", "backward", "moving backward", "x 0 to 0.1 rad", 0.85, 0.5, 30.0, 6.0, 1e-4)
    words = where_words(bins, (), (part,))
    assert words.startswith("sliding (90 % of the excess, 12 times the expected power)")
    assert "x 0 to 0.1 rad (95 % of the excess, 30 times the expected power)" in words
    assert words.endswith("mostly moving backward (85 %)")
    assert [b.bin for b in lead_of(bins)] == ["x 0 to 0.1 rad"]
    assert "over 1000 times" in where_words((_bin("regime", "sliding", 1.0, 2e5),))


def test_what_is_small_or_may_be_chance_is_not_reported():
    assert where_words((_bin("regime", "sliding", 1.0, 1.1),)) == "nowhere above the noise"
    assert where_words((_bin("regime", "sliding", 1.0, 3.0, p_value=0.2),)) == "nowhere above the noise"
    assert lead_of((_bin("regime", "sliding", 1.0, 3.0, p_value=0.2),)) == ()
