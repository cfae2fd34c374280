"""Signals have the level, the spectrum and the corners that their docstrings promise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import welch

import frictionjax.excitation as excitation
from frictionjax.core import InputError

N, RATE = 20_000, 2_000.0
KEY = jax.random.key(3)


@pytest.mark.parametrize(
    "draw",
    [
        lambda key, rms: excitation.prbs(key, N, RATE, 500.0, rms),
        lambda key, rms: excitation.gaussian_noise(key, N, RATE, 500.0, rms),
        lambda key, rms: excitation.multisine(key, N, RATE, (1.0, 500.0), rms),
    ],
    ids=["prbs", "gaussian_noise", "multisine"],
)
def test_random_signals_have_their_rms_and_differ_from_key_to_key(draw):
    signals = jax.vmap(draw, in_axes=(0, None))(jax.random.split(KEY, 8), 0.3)
    assert signals.shape == (8, N)
    assert signals.dtype == jnp.float64
    np.testing.assert_allclose(np.sqrt(np.mean(signals**2, axis=1)), 0.3, rtol=1e-12)
    # The mean is zero but for the tick that the end of the record may cut.
    assert np.max(np.abs(np.mean(signals, axis=1))) < 0.3 * 4.0 / N
    correlation = np.corrcoef(signals) - np.eye(8)
    assert np.max(np.abs(correlation)) < 5.0 / np.sqrt(N / 4.0)
    np.testing.assert_array_equal(draw(KEY, 0.3), draw(KEY, 0.3))


@pytest.mark.parametrize("bandwidth", [20.0, 125.0, 400.0, 1000.0])
def test_prbs_has_half_its_power_at_the_bandwidth(bandwidth):
    u = excitation.prbs(KEY, 200_000, RATE, bandwidth, 1.0)
    assert set(np.unique(u)) == {-1.0, 1.0}
    f, power = welch(u, RATE, nperseg=int(40.0 * RATE / bandwidth))
    left = power[np.argmin(np.abs(f - bandwidth))] / np.mean(power[(f > 0) & (f < 0.1 * bandwidth)])
    # The clock is a whole number of samples, never slower than asked: half the power or more.
    assert left > 0.4
    assert bandwidth > RATE / 5.0 or left < 0.75


def test_gaussian_noise_keeps_to_its_band():
    u = excitation.gaussian_noise(KEY, N, RATE, 300.0, 1.0, low=20.0)
    power = np.abs(np.fft.rfft(u)) ** 2
    f = np.fft.rfftfreq(N, 1.0 / RATE)
    inside = (f >= 20.0) & (f <= 300.0)
    assert np.max(power[~inside]) < 1e-20 * np.mean(power[inside])
    # Periodogram ordinates of Gaussian noise are exponential: standard deviation and mean are equal.
    assert np.std(power[inside]) / np.mean(power[inside]) == pytest.approx(
        1.0, abs=5.0 / np.sqrt(inside.sum())
    )
    assert np.mean(u**4) == pytest.approx(3.0, abs=5.0 * np.sqrt(96.0 / (2 * inside.sum())))


@pytest.mark.parametrize("odd", [False, True])
@pytest.mark.parametrize("n", [2000, 2001])
def test_a_multisine_has_equal_amplitudes_on_its_lines_and_none_elsewhere(n, odd):
    u = excitation.multisine(KEY, n, RATE, (10.0, 50.0), 2.0, odd=odd)
    amplitude = 2.0 / n * np.abs(np.fft.rfft(u))
    multiples = np.arange(amplitude.size)
    # With 2001 samples, 10 Hz lies between lines 10 and 11, and 50 Hz between 50 and 51.
    lines = (multiples >= n - 1990) & (multiples <= 50) & (not odd or multiples % 2 == 1)
    wanted = amplitude > 1e-9
    np.testing.assert_allclose(amplitude[wanted], 2.0 * np.sqrt(2.0 / wanted.sum()), rtol=1e-10)
    np.testing.assert_array_equal(wanted, lines)


def test_a_multisine_on_given_frequencies():
    u = excitation.multisine(KEY, N, RATE, [0.5, 7.0, 20.04], 1.0)
    amplitude = np.abs(np.fft.rfft(u)) / N
    assert np.flatnonzero(amplitude > 1e-9).tolist() == [5, 70, 200]


@pytest.mark.parametrize("group", [3, 4])
def test_one_odd_line_of_each_group_stays_silent(group):
    lines = excitation.multisine_lines(KEY, N, RATE, (1.0, 50.0), group=group)
    odd = np.arange(11, 500, 2)
    groups = odd.size // group
    assert lines.odd.size == groups or (lines.odd.size == groups - 1 and lines.excited[-1] < odd[-1])
    np.testing.assert_array_equal(
        np.unique(np.searchsorted(odd, lines.odd) // group), np.unique(np.arange(lines.odd.size))
    )
    assert np.all(lines.excited % 2 == 1)
    assert np.all(lines.even % 2 == 0)
    whole = np.sort(np.concatenate([lines.excited, lines.odd, lines.even]))
    np.testing.assert_array_equal(whole, np.arange(lines.excited[0], lines.excited[-1] + 1))
    u = excitation.multisine(KEY, N, RATE, lines.frequency, 0.5)
    assert np.flatnonzero(np.abs(np.fft.rfft(u)) / N > 1e-9).tolist() == lines.excited.tolist()


def test_silent_lines_are_drawn_evenly():
    """Which line of a group is silent differs from key to key, and each is as likely."""
    drawn = []
    for i in range(40):
        lines = excitation.multisine_lines(jax.random.key(i), N, RATE, (0.1, 80.0))
        inner = lines.odd[(lines.odd > 8) & (lines.odd < 792)]
        drawn.extend((inner - 1) // 2 % 4)
    counts = np.bincount(drawn, minlength=4)
    expected = len(drawn) / 4.0
    # Chi-square with three degrees of freedom.
    assert np.sum((counts - expected) ** 2) / expected < 25.9
    plain = excitation.multisine_lines(KEY, N, RATE, (0.1, 80.0), group=0)
    assert plain.odd.size == 0
    np.testing.assert_array_equal(plain.excited, np.arange(1, 801, 2))


def test_a_ramp_rests_rises_and_holds():
    u = excitation.ramp(2001, 1000.0, -3.0, rest=0.5, hold=0.25)
    assert np.all(u[:501] == 0.0)
    np.testing.assert_allclose(u[-251:], -3.0)
    np.testing.assert_allclose(np.diff(u[501:1750]), -3.0 / 1250.0, rtol=1e-9)
    np.testing.assert_allclose(excitation.ramp(11, 10.0, 1.0), np.linspace(0.0, 1.0, 11), atol=1e-12)


def test_a_presliding_loop_turns_where_it_should_at_one_rate():
    u = np.asarray(excitation.presliding_loop(40_001, 1000.0, 2.0, nested=(0.5, 0.25), rest=1.0))
    slope = np.diff(u[1001:-1001])
    turns = u[1001:-1001][np.flatnonzero(np.sign(slope[1:]) != np.sign(slope[:-1])) + 1]
    np.testing.assert_allclose(turns, [2.0, -2.0, 1.0, -1.0, 0.5, -0.5, 2.0], atol=2e-3)
    assert np.all(u[:1001] == 0.0)
    assert np.max(np.abs(u[-1001:])) < 1e-12
    rates = np.abs(slope)
    assert np.quantile(rates, 0.99) == pytest.approx(np.quantile(rates, 0.01), rel=1e-9)


def test_a_plain_presliding_loop_is_a_triangle():
    u = excitation.presliding_loop(801, 100.0, 1.0, cycles=2)
    expected = np.interp(np.arange(801), [0, 100, 300, 500, 700, 800], [0, 1, -1, 1, -1, 0])
    np.testing.assert_allclose(u, expected, atol=1e-12)


def test_levels_may_be_traced():
    levels = jnp.array([0.1, 0.2])
    loops = jax.vmap(lambda level: excitation.presliding_loop(100, 10.0, level))(levels)
    ramps = jax.vmap(lambda level: excitation.ramp(100, 10.0, level))(levels)
    np.testing.assert_allclose(loops[1], 2.0 * loops[0])
    np.testing.assert_allclose(ramps[1], 2.0 * ramps[0])


def test_moves_go_from_rest_to_rest_with_the_promised_peak_velocity():
    rate = 10_000.0
    x = np.asarray(excitation.point_to_point(35_000, rate, [0.2, -0.1], [1.0, 0.5], rests=[0.25, 0.75]))
    v = np.gradient(x, 1.0 / rate)
    assert np.all(x[:2500] == 0.0)
    np.testing.assert_allclose(x[12_500:20_000], 0.2, rtol=1e-12)
    np.testing.assert_allclose(x[25_000:], -0.1, rtol=1e-12)
    assert np.max(v) == pytest.approx(1.875 * 0.2, rel=1e-6)
    assert np.min(v) == pytest.approx(-1.875 * 0.3 / 0.5, rel=1e-6)
    assert np.max(np.abs(np.diff(v))) * rate < 6.0 * 0.3 / 0.5**2


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: excitation.prbs(KEY, N, RATE, 1500.0, 1.0), "1000.0 Hz"),
        (lambda: excitation.prbs(KEY, N, RATE, 0.0, 1.0), "`bandwidth`"),
        (lambda: excitation.gaussian_noise(KEY, N, RATE, 0.05, 1.0), "multiples of 0.1 Hz"),
        (lambda: excitation.multisine(KEY, N, RATE, (1200.0, 1500.0), 1.0), "below 1000.0 Hz"),
        (lambda: excitation.multisine(KEY, N, RATE, (0.2, 0.2), 1.0, odd=True), "no odd lines"),
        (lambda: excitation.multisine_lines(KEY, N, RATE, (1.0, 2.0)), "holds 5 odd lines"),
        (lambda: excitation.multisine_lines(KEY, N, RATE, (2000.0, 3000.0)), "holds 0 odd lines"),
        (lambda: excitation.multisine_lines(KEY, N, RATE, (1.0, 50.0), group=1), "`group` is 1"),
        (lambda: excitation.ramp(100, 100.0, 1.0, rest=0.6, hold=0.6), "`rest`"),
        (lambda: excitation.presliding_loop(100, 100.0, 1.0, nested=(0.2, 0.4)), "decreasing order"),
        (lambda: excitation.presliding_loop(100, 100.0, 1.0, cycles=0), "at least once"),
        (lambda: excitation.presliding_loop(100, 100.0, 1.0, rest=0.5), "leaves"),
        (lambda: excitation.point_to_point(100, 100.0, [1.0], 2.0), "at least 250"),
        (lambda: excitation.point_to_point(100, 100.0, [1.0, 2.0], [0.1, 0.1, 0.1]), "3 values for 2"),
        (lambda: excitation.point_to_point(100, 100.0, [1.0], 0.0), "not positive"),
        (lambda: excitation.point_to_point(100, 100.0, [], 1.0), "`positions`"),
    ],
)
def test_what_cannot_be_had_is_refused_with_a_cure(call, words):
    with pytest.raises(InputError, match=words):
        call()
