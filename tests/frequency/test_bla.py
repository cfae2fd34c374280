"""The best linear approximation: noise, odd and even distortion come out as what was put in."""

from itertools import combinations_with_replacement, permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete, freqz, lfilter
from scipy.stats import chi2, f, kstest

from frictionjax.core import InputError, PrecisionError
from frictionjax.excitation import multisine, multisine_lines
from frictionjax.frequency import best_linear_approximation, fit_sk

RATE, N = 1000.0, 1000
PLANT = cont2discrete(([16.0], [0.03, 4.0, 2000.0]), 1.0 / RATE)[:2]
LINES = multisine_lines(jax.random.key(5), N, RATE, (3.0, 201.0))


def _inputs(realisations, periods, rms=1.0, lines=LINES, seed=0):
    keys = jax.random.split(jax.random.key(seed), realisations)
    one = jax.vmap(lambda key: multisine(key, N, RATE, lines.frequency, rms))(keys)
    return np.tile(np.asarray(one), (1, periods))


def _plant(u):
    return lfilter(PLANT[0][0], PLANT[1], u, axis=1)


def _truth(bla):
    return freqz(PLANT[0][0], PLANT[1], worN=np.asarray(bla.frequency), fs=RATE)[1]


def _bla(u, x, **options):
    return best_linear_approximation(u, x, RATE, period=N, **{"lines": LINES, **options})


def test_without_noise_the_response_is_exact_and_the_silent_lines_are_silent():
    u = _inputs(1, 4)
    bla = _bla(u, _plant(u), transient=2)
    np.testing.assert_allclose(bla.frequency, LINES.frequency, rtol=1e-12)
    np.testing.assert_allclose(bla.response, _truth(bla), rtol=1e-9)
    assert (bla.periods, bla.realisations) == (2, 1)
    assert bla.total_variance is None
    assert bla.nonlinear_variance is None
    assert np.max(bla.odd.level) < 1e-9 * np.min(bla.output)
    assert np.max(bla.even.level) < 1e-9 * np.min(bla.output)
    # The parts carry the power that the signal has: by Parseval, to rounding.
    whole = np.sum(np.asarray(bla.output) ** 2)
    assert whole == pytest.approx(np.mean(_plant(u)[0, 2 * N :] ** 2), rel=1e-9)


def test_noise_variance_is_the_noise():
    """Known white noise at the output of 60 realisations: sums of squares within their chi-square quantiles."""
    m, periods, sigma = 60, 6, 0.01
    u = _inputs(m, periods)
    x = _plant(u) + sigma * np.random.default_rng(1).standard_normal(u.shape)
    bla = _bla(u, x)
    # A coefficient of one period has the variance sigma^2 / N; the mean over the periods that over their number.
    known = sigma**2 / N / (periods - 1)
    freedom = 2 * m * (periods - 2)
    power = np.full(len(LINES.excited), 0.5 / len(LINES.excited))  # |U|^2 of unit rms shared by the lines
    ratio = freedom * m * np.asarray(bla.noise_variance) * power / known
    assert kstest(ratio, chi2(freedom).cdf).pvalue > 1e-4
    np.testing.assert_allclose(np.mean(ratio) / freedom, 1.0, atol=5.0 * np.sqrt(2.0 / freedom / ratio.size))
    np.testing.assert_allclose(np.mean(bla.output_noise**2), 2.0 * known, rtol=0.1)
    # The response misses the truth by as much as it says, in both parts together.
    miss = 2.0 * np.abs(np.asarray(bla.response) - _truth(bla)) ** 2 * power * m / known
    assert kstest(miss, chi2(2).cdf).pvalue > 1e-4
    # A linear machine scatters from realisation to realisation as the noise alone makes it.
    total = 2 * (m - 1) * np.asarray(bla.total_variance) * power * m / known
    assert kstest(total, chi2(2 * (m - 1)).cdf).pvalue > 1e-4


def test_a_linear_machine_leaves_only_noise_at_the_detection_lines():
    m, periods, sigma = 3, 5, 0.01
    u = _inputs(m, periods)
    rng = np.random.default_rng(4)
    p_values = {"odd": [], "even": []}
    for _ in range(60):
        bla = _bla(u, _plant(u) + sigma * rng.standard_normal(u.shape))
        known = 2.0 * sigma**2 / N / (periods - 1)
        for name, values in p_values.items():
            found = getattr(bla, name)
            values.append(float(found.p_value))
            level = 2 * m * np.sum(found.level**2) / known
            tail = f.sf(float(found.ratio) ** 2, *np.asarray(found.freedom))
            assert float(found.p_value) == pytest.approx(tail, rel=1e-9)
            assert chi2.ppf(1e-6, 2 * m * found.level.size) < level < chi2.isf(1e-6, 2 * m * found.level.size)
    for values in p_values.values():
        assert kstest(values, "uniform").pvalue > 1e-4


def test_noise_of_a_measured_input_is_reported_too():
    """The input is measured with noise that moves the machine as well: no error; what is not shared counts."""
    m, periods, sigma = 60, 6, 0.05
    rng = np.random.default_rng(9)
    u = _inputs(m, periods)
    u = u + sigma * np.tile(rng.standard_normal((m, N)), (1, periods))
    bla = _bla(u, _plant(u))
    # It repeats itself, so it is input, on silent lines too; taken off, nothing is left but curvature between lines.
    raw = _bla(u, _plant(u), correct_input=False)
    assert np.mean(bla.even.level**2) < 0.02 * np.mean(raw.even.level**2)
    np.testing.assert_allclose(bla.response, _truth(bla), rtol=1e-7)


def _square_and_cube(quadratic, cubic, lines, excited):
    """Mean squares that independent phases give `x^2` and `x^3` on `lines`, term by term, with amplitudes of one.

    A sum of sines holds `exp(+-jw)/2` on each line; every product of them is one multiset, its phase its own.
    """
    signed = np.concatenate([excited, -excited])
    total = np.zeros(len(lines))
    where = {int(line): i for i, line in enumerate(lines)}
    for order, strength in ((2, quadratic), (3, cubic)):
        if not strength:
            continue
        for terms in combinations_with_replacement(signed.tolist(), order):
            if sum(terms) in where:
                multiplicity = len(set(permutations(terms)))
                total[where[sum(terms)]] += 2.0 * (strength * multiplicity * 0.5**order) ** 2
    return total


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.0, 0.3), (0.3, 0.0)])
def test_a_static_nonlinearity_gives_the_levels_of_theory(quadratic, cubic):
    """x + b x^2 + a x^3 behind a multisine: BLA 1 + 3 a rms^2 (1 - 1 / 2F); a answers on odd lines, b on even ones."""
    m, rms = 400, 0.7
    lines = multisine_lines(jax.random.key(2), N, RATE, (1.0, 47.0))
    count = lines.excited.size
    u = _inputs(m, 3, rms, lines, seed=3)
    bla = _bla(u, u + quadratic * u**2 + cubic * u**3, lines=lines)
    gain = 1.0 + 3.0 * cubic * rms**2 * (1.0 - 0.5 / count)
    z = np.abs(np.asarray(bla.response) - gain) / np.sqrt(np.asarray(bla.total_variance) + 1e-30)
    assert np.all(z < 4.5)
    assert np.mean(z**2) < 1.0 + 5.0 / np.sqrt(count)
    amplitude = rms * np.sqrt(2.0 / count)
    for found, silent in ((bla.odd, lines.odd), (bla.even, lines.even)):
        expected = _square_and_cube(
            quadratic * amplitude**2, cubic * amplitude**3, silent, np.asarray(lines.excited)
        )
        level = np.asarray(found.level) ** 2
        if np.all(expected == 0.0):
            assert np.max(level) < 1e-24
            assert float(found.distortion) < 1e-12
            continue
        # Mean squares of m nearly Gaussian numbers: exponential, so a standard error of the expected over sqrt(m),
        # and up to twice that for those of few terms.
        assert np.all(np.abs(level / expected - 1.0) < 2.0 * 4.5 / np.sqrt(m))
        assert np.sum(level) == pytest.approx(np.sum(expected), rel=0.1)
        assert float(found.distortion) == pytest.approx(np.sqrt(np.mean(expected)), rel=0.05)
    if cubic:
        # The scatter over realisations at excited lines is of the size of the level at odd silent ones.
        per_line = np.sqrt(2.0 * np.mean(bla.nonlinear_variance)) * amplitude / 2.0
        assert 0.5 < per_line / float(bla.odd.distortion) < 2.0


def test_the_second_order_system_is_fitted_to_it():
    u = _inputs(1, 12, lines=LINES)
    x = _plant(u) + 0.002 * np.random.default_rng(3).standard_normal(u.shape)
    bla = _bla(u, x)
    frf = bla.frf()
    np.testing.assert_allclose(frf.std, np.sqrt(0.5 * bla.noise_variance))
    n = bla.periods
    expected = np.abs(bla.response) ** 2 / (np.abs(bla.response) ** 2 + n * np.asarray(bla.noise_variance))
    np.testing.assert_allclose(frf.coherence, expected)
    sk = fit_sk(frf, (3.0, 150.0), motor_constant=16.0)
    assert sk.converged
    for name, truth in (("J", 0.03), ("stiffness", 2000.0), ("damping", 4.0)):
        found = getattr(sk, name)
        assert abs(found.value - truth) < 4.5 * found.stderr < 0.05 * truth
    several = _inputs(8, 3)
    x = _plant(several) + 0.002 * np.random.default_rng(3).standard_normal(several.shape)
    robust = _bla(several, x)
    np.testing.assert_allclose(robust.frf().std, np.sqrt(0.5 * robust.total_variance))
    assert robust.frf().averages_effective == 8.0


def test_it_runs_in_jit_and_without_silent_lines():
    u = _inputs(8, 3)
    x = _plant(u)
    plain = _bla(u, x)
    traced = jax.jit(lambda u, x: _bla(u, x).response)(jnp.asarray(u), jnp.asarray(x))
    np.testing.assert_allclose(traced, plain.response, rtol=1e-9)
    full = _bla(
        np.tile(np.asarray(multisine(jax.random.key(0), N, RATE, (1.0, 40.0), 1.0)), 3),
        x[0],
        lines=range(1, 41),
    )
    assert full.odd.level.shape == full.even.level.shape == (0,)
    assert (float(full.odd.p_value), float(full.odd.distortion)) == (1.0, 0.0)
    one = _bla(u[0], x[0])
    np.testing.assert_allclose(one.odd.frequency, LINES.odd * RATE / N)
    assert np.all(np.isfinite(one.noise_variance))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x": np.zeros((2, 4 * N))}, "shape"),
        ({"x": np.full((1, 4 * N), np.nan)}, "`x` holds values that are not finite"),
        ({"u": np.zeros((1, 1, 4 * N))}, "realisations of shape"),
        ({"transient": 3}, "holds 4 periods of 1000 samples"),
        ({"transient": -1}, "`transient`"),
        ({"period": 3000}, "check `period`"),
        ({"lines": []}, "0 lines"),
        ({"lines": [500]}, "1 to 499"),
        ({"lines": [0, 3]}, "reach to 3"),
        ({"lines": [3, 5, 6]}, "no power on 1 of 3 `lines`, the first 6"),
    ],
)
def test_bad_arguments_are_refused_with_a_cure(change, words):
    u = np.tile(np.asarray(multisine(jax.random.key(0), N, RATE, [3.0, 5.0], 1.0)), (1, 4))
    arguments = {"u": u, "x": u, "period": N, "lines": [3, 5], **change}
    u, x = arguments.pop("u"), arguments.pop("x")
    with pytest.raises(InputError, match=words):
        best_linear_approximation(u, x, RATE, **arguments)


def test_float32_is_refused():
    with jax.enable_x64(False), pytest.raises(PrecisionError):
        _bla(np.zeros((1, 4 * N)), np.zeros((1, 4 * N)))
