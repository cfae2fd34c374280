"""The map: a planted error is found in its bin, and the shares of an axis add to 1."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE
from scipy.signal import lfilter

from frictionjax.diagnosis.judge import Scene
from frictionjax.diagnosis.locate import Motion, axes_of, mismatch_map, strongest, where_words
from frictionjax.diagnosis.verdict import MismatchBin
from frictionjax.diagnosis.wavelengths import wavelengths
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.scales import plant_scales
from frictionjax.recordings import Plant, Recording
from frictionjax.simulation import innovation_gain, observer_gains

N = 16000
T = np.arange(N) / RATE
UNITS = Plant(motor_constant=16.0, position_unit="rad", force_unit="N*m", input_unit="V")
AXES = ("regime", "direction", "velocity", "position", "input", "since_reversal", "time", "frequency")


def _swing(frequency, amplitude=0.2):
    """Position and velocity of a swing."""
    phase = 2.0 * np.pi * frequency * T
    return amplitude * np.sin(phase), 2.0 * np.pi * frequency * amplitude * np.cos(phase)


@pytest.fixture(scope="module")
def world():
    """Two swings of 8 s; what the base model saw of them, with a bristle that is bent in every way in turn."""
    swings = [_swing(0.5), _swing(0.8)]
    u = [0.05 * np.sin(2.0 * np.pi * 0.11 * T), 0.02 * np.cos(2.0 * np.pi * 0.23 * T)]
    noise = np.random.default_rng(1).standard_normal((2, N))
    recordings = tuple(
        Recording(name, RATE, push, x + 1e-6 * wiggle)
        for name, push, (x, _), wiggle in zip(("one", "two"), u, swings, noise, strict=True)
    )
    batch = make_batch(recordings, encoder_step=FINE)
    scene = Scene(batch, np.array([False, True]), 50.0, tuple(r.name for r in recordings))
    motion = Motion(
        np.stack([x for x, _ in swings]),
        np.stack([v for _, v in swings]),
        np.stack([np.abs(np.sin(2.0 * np.pi * 0.37 * T)), np.ones(N)]),
        np.stack(u),
    )
    return scene, motion, axes_of(motion, PLANT, UNITS, scene)


def _innovations(scene, seed=0):
    """Innovations of a true model, standardised: white noise as the observer sees it, (1 - q)^2 / (1 - p q)^2."""
    pole = np.exp(-2.0 * np.pi * scene.bandwidth / RATE)
    noise = np.random.default_rng(seed).standard_normal((2, N))
    seen = lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole, pole**2], noise)
    return seen / float(innovation_gain(observer_gains(scene.bandwidth, 1.0 / RATE)))


def _map(scene, axes, e, after=None):
    return mismatch_map(SimpleNamespace(e=e), SimpleNamespace(e=e if after is None else after), axes, scene)


def test_every_axis_is_there_and_its_shares_add_to_one(world):
    scene, _, axes = world
    e = _innovations(scene) * (1.0 + 0.3 * np.sin(2.0 * np.pi * 0.3 * T))
    bins = _map(scene, axes, e)
    assert {b.axis for b in bins} == set(AXES)
    for axis in AXES:
        assert sum(b.share for b in bins if b.axis == axis) == pytest.approx(1.0)
        assert all(0.0 <= b.share <= 1.0 for b in bins if b.axis == axis)
    assert all(np.isfinite(b.excess) and b.count > 0 for b in bins)


def test_bins_of_an_axis_hold_every_sample_once(world):
    _, _, axes = world
    for axis in ("regime", "direction", "velocity", "input", "since_reversal", "time"):
        held = np.sum([mask.astype(int) for mask in axes[axis].values()], axis=0)
        assert np.all(held == 1), axis
    # A position on the border of two bins may lie in both.
    held = np.sum([mask.astype(int) for mask in axes["position"].values()], axis=0)
    assert np.mean(held == 1) > 0.999


PLANTED = {
    "direction": ("backward", lambda m: m.v < -0.05),
    "position": ("x 0.05 to 0.1 rad", lambda m: (m.x > 0.05) & (m.x < 0.1)),
    "time": ("two, 2.67 to 5.33 s", lambda m: (T > 2.67) & (T < 5.33) & (np.arange(2)[:, None] == 1)),
    "regime": ("sliding", lambda m: np.abs(m.v) > 0.3),
}


@pytest.mark.parametrize("axis", PLANTED)
def test_a_planted_error_is_found_in_its_bin(world, axis):
    scene, motion, axes = world
    label, where = PLANTED[axis]
    e = _innovations(scene)
    bins = _map(scene, axes, e + 8.0 * where(motion) * _innovations(scene, seed=1), after=e)
    found = strongest(bins, axis)
    assert found is not None
    assert found.bin == label
    assert found.share > 0.8
    assert found.excess > 10.0
    assert found.excess_extended == pytest.approx(1.0, abs=0.15)


def test_an_error_after_reversals_is_found_there(world):
    scene, motion, axes = world
    turned = np.diff(np.sign(motion.v), axis=1, prepend=np.sign(motion.v[:, :1])) != 0
    after = np.stack([np.convolve(row, np.ones(150), "full")[:N] > 0 for row in np.roll(turned, 45, axis=1)])
    bins = _map(scene, axes, _innovations(scene) + 8.0 * after * _innovations(scene, seed=1))
    found = strongest(bins, "since_reversal")
    assert found is not None
    assert found.bin == "20 to 100 ms after a reversal"
    assert found.share > 0.8


def test_an_error_of_one_frequency_is_found_in_its_band(world):
    scene, _, axes = world
    bins = _map(scene, axes, _innovations(scene) + 3.0 * np.sin(2.0 * np.pi * 33.0 * T))
    found = strongest(bins, "frequency")
    assert found is not None
    assert found.bin == "20 to 50 Hz"
    assert found.share > 0.9


def test_noise_stands_out_nowhere(world):
    scene, _, axes = world
    bins = [b for b in _map(scene, axes, _innovations(scene)) if b.axis != "frequency"]
    # The mean square of few samples has a standard error of sqrt(2/n), a little more as they are correlated.
    assert all(abs(b.excess - 1.0) < 5.0 * np.sqrt(2.0 / b.count) for b in bins)
    assert all(strongest(tuple(bins), axis) is None for axis in AXES)


def test_noise_stands_out_in_no_band(world):
    """The observer leaves next to nothing at low frequencies: what leaks there must not look like a finding."""
    scene, _, axes = world
    bands = [b for b in _map(scene, axes, _innovations(scene)) if b.axis == "frequency"]
    assert {b.bin: b.excess for b in bands if b.excess > 1.5} == {}


def test_a_bin_with_few_samples_is_left_out(world):
    scene, motion, _ = world
    mask = np.zeros(motion.x.shape, bool)
    mask[0, 1000:1100] = True
    bins = _map(scene, {"regime": {"few": mask, "most": ~mask}}, _innovations(scene))
    assert [b.bin for b in bins if b.axis == "regime"] == ["most"]


def test_not_finite_innovations_leave_a_finite_map(world):
    scene, _, axes = world
    e = _innovations(scene)
    e[0, 5000:5100] = np.nan
    assert all(np.isfinite(b.share) and np.isfinite(b.excess) for b in _map(scene, axes, e))


def _bin(axis, label, share, excess):
    return MismatchBin(axis, label, share, excess, 1.0, 1000)


def test_where_is_told_in_words():
    bins = (
        _bin("regime", "sliding", 0.9, 12.34),
        _bin("regime", "stick", 0.1, 1.3),
        _bin("direction", "backward", 0.85, 9.0),
        _bin("direction", "forward", 0.15, 1.5),
        _bin("position", "x 0 to 0.1 rad", 0.95, 30.0),
        _bin("position", "x 0.1 to 0.2 rad", 0.05, 1.3),
    )
    words = where_words(bins)
    assert words.startswith("sliding (90 % of the excess, 12 times the expected power)")
    assert "moving backward (85 %)" in words
    assert words.endswith("x 0 to 0.1 rad (95 %)")
    assert "over 1000 times" in where_words((_bin("regime", "sliding", 1.0, 2e5),))
    assert where_words((_bin("regime", "sliding", 1.0, 1.1),)) == "nowhere above the noise"


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
    found = wavelengths(e, v, batch, odd=odd)
    assert found[0] == pytest.approx(period, rel=0.01)
    assert len(set(found)) == len(found) == 3


def test_friction_is_told_from_cogging(stroke):
    """A friction that varies is odd in the velocity; seen as even it averages out."""
    x, v, batch = stroke
    wave = 3.0 * np.sin(2.0 * np.pi * x / 0.05)
    e = wave * np.sign(v) + np.random.default_rng(3).standard_normal(x.shape)
    assert wavelengths(e, v, batch, odd=True)[0] == pytest.approx(0.05, rel=0.01)
    assert wavelengths(e, v, batch, odd=False)[0] != pytest.approx(0.05, rel=0.05)


def test_without_motion_there_is_no_period():
    still = Recording("still", RATE, 0 * T[:2000], 1e-6 * np.random.default_rng(4).standard_normal(2000))
    batch = make_batch((still,), encoder_step=FINE)
    assert wavelengths(np.ones((1, 2000)), np.zeros((1, 2000)), batch, odd=True) == ()


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
