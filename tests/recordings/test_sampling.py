"""Time stamps: what counts as uniform, and what happens to what does not."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from frictionjax.core import InputError
from frictionjax.recordings.readers.arrays import ArrayTable
from frictionjax.recordings.sampling import find_grid

TABLE = ArrayTable(Path("run.mat"), ("t",), {}, {}, "variable", {}, {})
RNG = np.random.default_rng(7)


@pytest.fixture(autouse=True)
def same_noise_in_every_order():
    RNG.bit_generator.state = np.random.default_rng(7).bit_generator.state


def grid(stamps):
    return find_grid(np.asarray(stamps, dtype=float), TABLE, "t")


@pytest.mark.parametrize("rate", [1000.0, 2000.0, 200.0, 44.1, 10000.0 / 3.0, 48000.0])
def test_uniform_time_is_left_alone(rate):
    found = grid(np.arange(5000) / rate)
    np.testing.assert_allclose(found.sample_rate, rate, rtol=1e-12)
    assert found.uniform is None and found.sampling.jitter < 1e-6


@pytest.mark.parametrize(
    ("rate", "decimals"), [(3000.0, 4), (3000.0, 5), (48000.0, 6), (600.0, 3), (7.0, 2), (700.0, 3)]
)
def test_rounded_stamps_are_not_jitter(rate, decimals):
    found = grid(np.round(np.arange(5000) / rate, decimals))
    assert found.uniform is None and found.sampling.jitter == 0.0
    np.testing.assert_allclose(found.sample_rate, rate, rtol=1e-4)


def test_stamps_far_from_zero_and_single_precision_are_not_jitter():
    assert grid(1.7e9 + np.arange(5000) / 10000.0).uniform is None
    assert grid(np.float32(np.arange(20000) / 1000.0)).uniform is None


def test_a_nearly_whole_rate_is_whole():
    assert grid(np.arange(5000) * 0.9999999e-3).sample_rate == 1000.0
    assert grid(np.arange(5000) * 0.999e-3).sample_rate == pytest.approx(1001.001)


@pytest.mark.parametrize("size", [0.01, 0.2])
def test_jitter_is_measured_and_resampled(size):
    t = (np.arange(4000) + RNG.uniform(-size, size, 4000)) / 1000.0
    found = grid(t)
    assert found.sampling.resampled and not found.sampling.gaps
    assert size < found.sampling.jitter <= 2.0 * size * 1.01
    np.testing.assert_allclose(found.sample_rate, 1000.0, rtol=1e-4)
    assert found.uniform is not None and found.uniform.size == 4000
    x = np.sin(2.0 * np.pi * 5.0 * t)
    np.testing.assert_allclose(
        found.follow(x)[1:-1], np.sin(2.0 * np.pi * 5.0 * found.uniform)[1:-1], atol=1e-3
    )


def test_a_motion_is_followed_round_its_corners():
    """Straight lines would be off by a dt^2 / 8, a thousand times what is allowed here."""
    t = (np.arange(4000) + RNG.uniform(-0.2, 0.2, 4000)) / 1000.0
    found = grid(t)
    assert found.uniform is not None
    curve = (2.0 * np.pi * 5.0) ** 2 * 1e-6 / 8.0
    off = found.follow(np.sin(2.0 * np.pi * 5.0 * t)) - np.sin(2.0 * np.pi * 5.0 * found.uniform)
    assert np.abs(off[5:-5]).max() < 1e-3 * curve


def test_what_a_gap_hides_is_not_swung_through():
    """A spline would leave the last two samples with their slope."""
    keep = np.r_[0:1000, 1050:2000]
    x = np.where(keep < 999, 0.0, np.where(keep < 1050, 1.0, 2.0))
    filled = grid(keep / 1000.0).follow(x)
    np.testing.assert_allclose(filled[1000:1050], np.interp(np.arange(1000, 1050), [999, 1050], [1.0, 2.0]))


def test_an_input_keeps_its_momentum_from_stamp_to_stamp():
    """The mean of what was held: by summation over a fine grid, and in all."""
    u = np.repeat(RNG.choice([-1.0, 1.0], 400), 10)
    t = (np.arange(4000) + RNG.uniform(-0.2, 0.2, 4000)) / 1000.0
    found = grid(t)
    assert found.uniform is not None
    fine = found.uniform[:, None] + (np.arange(2000) + 0.5) / 2000.0 / found.sample_rate
    held = u[np.clip(np.searchsorted(t, fine, side="right") - 1, 0, None)]
    np.testing.assert_allclose(found.hold(u), held.mean(1), atol=1e-3)
    assert np.abs(found.hold(u)).max() < 1.0 + 1e-9
    first, last, step = found.uniform[0], found.uniform[-1], found.uniform[1] - found.uniform[0]
    given = np.sum(u[:-1] * np.diff(t)) + u[-1] * (last + step - t[-1]) + u[0] * (t[0] - first)
    np.testing.assert_allclose(found.hold(u).sum() * step, given, rtol=1e-9)


def test_gaps_are_counted_and_filled():
    keep = np.r_[0:1000, 1002:2500, 2550:5000]
    found = grid(keep / 1000.0)
    assert [round(time, 6) for time, _ in found.sampling.gaps] == [0.999, 2.499]
    assert [round(length, 6) for _, length in found.sampling.gaps] == [0.003, 0.051]
    assert (found.sampling.missing, found.sample_rate, found.sampling.jitter < 1e-6) == (52, 1000.0, True)
    ramp = keep / 100.0
    np.testing.assert_allclose(found.follow(ramp), np.arange(5000) / 100.0, atol=1e-9)
    held = found.hold(keep.astype(float))
    np.testing.assert_allclose(held[[999, 1000, 1001, 1002]], [999.0, 999.0, 999.0, 1002.0], rtol=1e-9)


def test_one_stamp_out_of_place_is_found():
    t = np.arange(1000) / 1000.0
    t[500] += 2e-4
    found = grid(t)
    assert found.sampling.resampled
    np.testing.assert_allclose(found.sampling.jitter, 0.2, rtol=1e-3)


@pytest.mark.parametrize("k", [1, 500, 999])
@pytest.mark.parametrize(
    ("back", "word"), [(0.0, "stands still"), (-1e-10, "stands still"), (0.3, "goes backwards")]
)
def test_time_must_go_forward(k, back, word):
    t = np.arange(1000) / 1000.0
    t[k] = t[k - 1] - back
    with pytest.raises(InputError, match=f"sample {k + 1}, column `t`: time {word}"):
        grid(t)


def test_a_stamp_that_came_early_is_jitter():
    t = np.arange(1000) / 1000.0
    t[500] = t[499] + 1e-8
    assert grid(t).sampling.jitter > 0.9


def test_too_much_missing_is_refused():
    with pytest.raises(InputError, match="not a uniformly sampled recording"):
        grid(np.cumsum(RNG.exponential(1e-3, 1000) + 1e-5))


@given(place=st.integers(1, 999), exponent=st.floats(15.0, 308.0))
def test_a_stamp_beyond_all_counting_is_refused(place, exponent):
    """Of a damaged file: so many samples are missing that no whole number holds them."""
    t = np.arange(1000) / 1000.0
    t[place:] += 10.0**exponent
    assume(np.all(np.diff(t[: place + 1]) > 0.0))
    with pytest.raises(InputError):
        grid(t)
    t = np.arange(1000) / 1000.0
    t[-1] = 10.0**exponent
    with pytest.raises(InputError, match="not a uniformly sampled recording"):
        grid(t)
