"""Periods along the stroke, and the sizes of a plant that effects are scaled by."""

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE

from frictionjax.diagnosis.screening.periods import Wavelengths, wavelengths
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.scales import plant_scales
from frictionjax.recordings import Recording

N = 16000
T = np.arange(N) / RATE


def _swing(frequency, amplitude=0.2):
    """Position and velocity of a swing."""
    phase = 2.0 * np.pi * frequency * T
    return amplitude * np.sin(phase), 2.0 * np.pi * frequency * amplitude * np.cos(phase)


@pytest.fixture(scope="module")
def stroke():
    """Slow strokes to and fro over 0.4 rad: position, velocity, and the batch they are in."""
    x, v = _swing(0.25)
    x2, v2 = _swing(0.5)
    wiggle = 1e-6 * np.random.default_rng(2).standard_normal((2, N))
    push = 0.1 + 0 * T
    recordings = (Recording("one", RATE, push, x + wiggle[0]), Recording("two", RATE, push, x2 + wiggle[1]))
    return np.stack([x, x2]), np.stack([v, v2]), make_batch(recordings, encoder_step=FINE)


@pytest.mark.parametrize("period", [0.0432, 0.0871])
@pytest.mark.parametrize("odd", [True, False])
def test_a_planted_period_is_found(stroke, period, odd):
    """Within 1 %, under noise as large as itself; of friction (odd) and of cogging (even)."""
    x, v, batch = stroke
    wave = np.sin(2.0 * np.pi * x / period + 0.7) * (np.sign(v) if odd else 1.0)
    e = wave + np.random.default_rng(3).standard_normal(x.shape)
    found = wavelengths(e, v, batch, odd=odd).periods
    assert found[0] == pytest.approx(period, rel=0.01)
    assert len(set(found)) == len(found) == 3


def test_a_wave_of_the_sensor_that_passes_in_less_than_a_sample_is_found(stroke):
    """36 000 of them along the stroke; at 0.3 rad/s fourteen between two samples."""
    x, v, batch = stroke
    period = 1.1e-5
    e = np.sin(2.0 * np.pi * x / period + 0.7) + np.random.default_rng(3).standard_normal(x.shape)
    found = wavelengths(e, v, batch, odd=False, count=2, fine=True).periods
    # Over the stroke it is off by less than a quarter of a wave: a descent finds the rest.
    assert found[0] == pytest.approx(period, rel=0.25 * period / 0.4)


def test_a_period_is_counted_among_those_it_was_chosen_from(stroke):
    """Waves of the whole stroke that fit between the longest and the shortest that are looked for."""
    x, v, batch = stroke
    e = np.random.default_rng(3).standard_normal(x.shape)
    coarse, fine = wavelengths(e, v, batch, odd=False), wavelengths(e, v, batch, odd=False, fine=True)
    for found, least in ((coarse, 2), (fine, 20)):
        shortest = np.ptp(x) / (found.among + least)
        assert found.among > 10
        assert min(found.periods) >= 0.99 * shortest
    assert fine.among > 100 * coarse.among


def test_friction_is_reported_from_cogging(stroke):
    """A friction that varies is odd in the velocity; seen as even it averages out."""
    x, v, batch = stroke
    wave = 3.0 * np.sin(2.0 * np.pi * x / 0.05)
    e = wave * np.sign(v) + np.random.default_rng(3).standard_normal(x.shape)
    assert wavelengths(e, v, batch, odd=True).periods[0] == pytest.approx(0.05, rel=0.01)
    assert wavelengths(e, v, batch, odd=False).periods[0] != pytest.approx(0.05, rel=0.05)


def test_a_fast_move_and_a_bias_in_stick_do_not_hide_a_short_period():
    """A quarter of the time the machine vibrates in stick, held off its model; once it moves ten times faster."""
    fast = np.where(T[-1] / 20.0 > T, T, 0.0)
    x = np.stack([_swing(0.5)[0], 1e-5 * np.sin(2.0 * np.pi * 90.0 * T) + 0.05])
    x[0] += 0.1 * np.sin(2.0 * np.pi * 5.0 * fast)
    v = np.gradient(x, 1.0 / RATE, axis=1)
    noise = np.random.default_rng(2).standard_normal((2, N))
    recordings = tuple(
        Recording(name, RATE, 0.1 + 0 * T, x[k] + 1e-6 * noise[k]) for k, name in enumerate("ab")
    )
    batch = make_batch(recordings, encoder_step=FINE)
    period = 0.02
    e = 2.0 * np.sin(2.0 * np.pi * x / period + 0.7) + np.random.default_rng(3).standard_normal(x.shape)
    assert np.mean(e[1]) ** 2 > 0.5
    assert wavelengths(e, v, batch, odd=False).periods[0] == pytest.approx(period, rel=0.01)


def test_without_motion_there_is_no_period():
    still = Recording("still", RATE, 0 * T[:2000], 1e-6 * np.random.default_rng(4).standard_normal(2000))
    batch = make_batch((still,), encoder_step=FINE)
    assert wavelengths(np.ones((1, 2000)), np.zeros((1, 2000)), batch, odd=True) == Wavelengths()


def test_the_plant_gives_the_scales(stroke):
    scales = plant_scales(PLANT, stroke[2])
    friction = PLANT.friction
    assert scales["Fc"] == float(friction.Fc)
    assert scales["zs"] == pytest.approx(float(friction.Fs / friction.sigma0))
    assert scales["stroke"] == pytest.approx(0.4, rel=1e-3)
    assert scales["center"] == pytest.approx(0.0, abs=1e-4)
    assert scales["Fc/stroke"] == pytest.approx(scales["Fc"] / scales["stroke"])
    assert scales["dt"] == 1.0 / RATE
    assert scales["1/u^2"] == pytest.approx(100.0)
    assert scales["step"] == pytest.approx(1e-6, rel=0.1)
    # The faster swing: 0.2 rad at 0.5 Hz.
    assert scales["Fc/speed^2"] == pytest.approx(scales["Fc"] / (0.2 * np.pi) ** 2, rel=0.01)
