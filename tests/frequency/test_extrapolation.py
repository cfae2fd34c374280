"""The stiffness at zero amplitude is found, with an honest standard error, from curves whose limit is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import TABLE_I
from scipy.stats import chi2

from frictionjax.core import InputError
from frictionjax.excitation import multisine
from frictionjax.frequency import best_linear_approximation, extrapolate_to_zero_amplitude
from frictionjax.simulation import simulate

LEVELS = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.26])


@pytest.mark.parametrize("coefficients", [(0.8, 0.0), (0.0, 3.0), (0.3, 2.1)])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e7])
def test_a_curve_without_noise_gives_its_limit(coefficients, unit):
    a, b = coefficients
    y = unit * (1.0 - a * LEVELS - b * LEVELS**2)
    found = extrapolate_to_zero_amplitude(unit * LEVELS, y, 1e-4 * y, unit="N/m")
    assert abs(found.stiffness.value / unit - 1.0) < 2e-4
    assert abs(found.stiffness.value - unit) < 3.0 * found.stiffness.stderr
    assert found.stiffness.unit == "N/m"
    assert found.stiffness.identified
    assert found.curve(0.0) == pytest.approx(found.stiffness.value, rel=1e-12)
    # Curves that leave out the highest levels have a share in the mean, and miss them.
    np.testing.assert_allclose(found.curve(unit * LEVELS[:3]), y[:3], rtol=1e-3)
    np.testing.assert_allclose(found.curve(unit * LEVELS), y, rtol=1e-2)
    assert found.warnings == ()


@pytest.mark.parametrize("relative", [0.001, 0.01])
def test_the_standard_error_is_the_scatter(relative):
    """Two hundred noisy curves: no bias beyond its own standard error, and a spread that the errors cover."""
    rng = np.random.default_rng(7)
    truth = 1.0 - 0.3 * LEVELS - 2.1 * LEVELS**2
    z = []
    for _ in range(200):
        y = truth + relative * rng.standard_normal(LEVELS.size)
        found = extrapolate_to_zero_amplitude(LEVELS, y, np.full(LEVELS.size, relative)).stiffness
        z.append((found.value - 1.0) / found.stderr)
    z = np.array(z)
    # The choice of a curve is in the error, so it may be wide, but by no more than twice; and never too narrow.
    assert chi2.ppf(1e-5, 200) / 4.0 < np.sum(z**2) < chi2.ppf(1.0 - 1e-5, 200)
    assert np.mean(np.abs(z) < 1.96) > 0.95 - 4.0 * np.sqrt(0.95 * 0.05 / 200.0)


@pytest.mark.parametrize("relative", [0.002, 0.005, 0.01])
def test_the_sweep_of_table_one_ends_at_sigma0(relative):
    """Independently computed stiffnesses of Table I under a PRBS; the highest level is 22 % below the truth."""
    y = np.array([9.93e4, 9.48e4, 8.47e4, 7.77e4])
    found = extrapolate_to_zero_amplitude([0.02, 0.1, 0.2, 0.26], y, relative * y)
    assert found.stiffness.value == pytest.approx(1e5, rel=0.02)
    assert abs(found.stiffness.value - 1e5) < 2.0 * found.stiffness.stderr
    assert found.stiffness.stderr < 2e3
    # The same without the level that is all but the answer.
    without = extrapolate_to_zero_amplitude([0.1, 0.2, 0.26], y[1:], relative * y[1:])
    assert abs(without.stiffness.value - 1e5) < 2.0 * without.stiffness.stderr


def test_what_the_choice_of_a_curve_leaves_open_is_in_the_error(monkeypatch):
    """Law of total variance: two forms that fit equally well and disagree make the error wider by half of that."""
    levels = np.array([0.1, 0.15, 0.2, 0.26])
    y = 1.0 - 1.5 * levels**1.5
    both = {}
    for forms in ({"a": (1,)}, {"b": (2,)}, {"a": (1,), "b": (2,)}):
        monkeypatch.setattr("frictionjax.frequency.extrapolation.FORMS", forms)
        both["".join(forms)] = extrapolate_to_zero_amplitude(levels, y, np.full(4, 0.01)).stiffness
    one, two, mean = both["a"], both["b"], both["ab"]
    share = (mean.value - two.value) / (one.value - two.value)
    assert 0.2 < share < 0.8
    within = share * one.stderr**2 + (1.0 - share) * two.stderr**2
    between = share * (1.0 - share) * (one.value - two.value) ** 2
    assert between > 0.2 * within
    assert mean.stderr**2 == pytest.approx(within + between, rel=1e-9)


def test_levels_beyond_the_curve_are_left_out():
    """A collapse at high levels, as of a machine that breaks away, does not reach the limit."""
    levels = np.append(LEVELS, [0.4, 0.6, 0.8])
    y = 1.0 - 0.3 * levels - 2.1 * levels**2
    y[-3:] = [0.3, 0.28, 0.27]
    found = extrapolate_to_zero_amplitude(levels, y, np.full(levels.size, 1e-3))
    assert abs(found.stiffness.value - 1.0) < 3.0 * found.stiffness.stderr < 0.02
    assert found.highest <= 0.4
    assert np.all(found.weight[-2:] < 0.01)
    assert np.all(np.diff(found.weight) <= 1e-12)
    assert f"levels from 0.02 to {found.highest:.4g}" in found.message


def test_the_order_of_the_levels_does_not_matter_and_levels_may_repeat():
    rng = np.random.default_rng(1)
    levels = np.repeat(LEVELS, 3)
    y = 1.0 - 2.0 * levels**2 + 1e-3 * rng.standard_normal(levels.size)
    order = rng.permutation(levels.size)
    s = np.full(levels.size, 1e-3)
    one = extrapolate_to_zero_amplitude(levels, y, s)
    other = extrapolate_to_zero_amplitude(levels[order], y[order], s)
    assert one.stiffness.value == pytest.approx(other.stiffness.value, rel=1e-12)
    assert one.message == other.message


def test_what_a_reader_must_know_is_said():
    rng = np.random.default_rng(2)
    y = 1.0 - 2.0 * LEVELS**2
    scattered = extrapolate_to_zero_amplitude(LEVELS, y + 0.01 * rng.standard_normal(6), np.full(6, 1e-4))
    assert any("scatter about the best curve" in warning for warning in scattered.warnings)
    assert scattered.stiffness.stderr > 1e-3
    hardening = extrapolate_to_zero_amplitude(LEVELS, 2.0 - y, np.full(6, 1e-4))
    assert not any("rises" in warning for warning in scattered.warnings)
    steep = extrapolate_to_zero_amplitude(LEVELS + 0.2, 1.0 + 0.5 * LEVELS, np.full(6, 1e-4))
    assert any("rises with the level" in warning for warning in (*hardening.warnings, *steep.warnings))
    vague = extrapolate_to_zero_amplitude(LEVELS, y, np.full(6, 0.3))
    assert any("% of the value" in warning for warning in vague.warnings)


@pytest.mark.parametrize(
    ("levels", "stiffness", "stderr", "words"),
    [
        ([0.1, 0.2], [1.0, 0.9], [0.01, 0.01], "2 different levels .* needs three"),
        ([0.1, 0.1, 0.2], [1.0, 1.0, 0.9], [0.01] * 3, "2 different levels"),
        ([0.1, 0.2, 0.3], [1.0, 0.9], [0.01] * 3, "shapes"),
        ([0.1, 0.2, 0.3], [1.0, 0.9, np.nan], [0.01] * 3, "entry 2"),
        ([0.0, 0.2, 0.3], [1.0, 0.9, 0.8], [0.01] * 3, "level 0.0"),
        ([0.1, 0.2, 0.3], [1.0, 0.9, 0.8], [0.01, np.inf, 0.01], "standard error inf"),
        ([0.1, 0.2, 0.3], [1.0, 0.9, 0.8], [0.01, 0.0, 0.01], "must be positive"),
    ],
)
def test_bad_arguments_are_refused_with_a_cure(levels, stiffness, stderr, words):
    with pytest.raises(InputError, match=words):
        extrapolate_to_zero_amplitude(levels, stiffness, stderr)


@pytest.mark.parametrize("level", [0.02, 0.1])
def test_the_bristles_soften_as_the_theory_says(level):
    """(sigma0 + sigma1 jw) jw / (jw + rate), with rate = E|v| sigma0 / Fs, against simulated multisines.

    What the theory leaves out is of the second order in what it takes away: a tenth of that, at these levels.
    """
    rate, n = 5000.0, 5000
    lines = np.arange(1, 500, 2)
    keys = jax.random.split(jax.random.key(1), 8)
    u = jax.vmap(lambda key: jnp.tile(multisine(key, n, rate, lines * rate / n, 1.5 * level), 3))(keys)
    motion = jax.vmap(lambda part: simulate(TABLE_I, part, rate))(u)
    bla = best_linear_approximation(u, motion.x, rate, period=n, lines=lines)
    s = 2j * np.pi * np.asarray(bla.frequency)
    # The hold's half sample and what the mass and the viscous friction take: what is left is the bristles.
    hold = np.sinc(s.imag / (2.0 * np.pi * rate)) * np.exp(-s / (2.0 * rate))
    friction = hold / np.asarray(bla.response) - s**2 - 0.4 * s
    softening = 1e5 / 1.5 * float(jnp.mean(jnp.abs(motion.v)))
    band = (s.imag > 2.0 * np.pi * 20.0) & (s.imag < 2.0 * np.pi * 120.0)
    expected = (1e5 + 1e5**0.5 * s) * s / (s + softening)
    lost, told = (1e5 - np.real(part[band]).mean() for part in (friction, expected))
    assert lost == pytest.approx(told, rel=0.1)
