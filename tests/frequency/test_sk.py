"""The Sanathanan-Koerner fit recovers what made the response, knows how well, and says when it does not."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete, freqz, lfilter
from scipy.stats import chi2

from frictionjax.core import InputError, PrecisionError
from frictionjax.frequency import FRF, SKResult, estimate_frf, fit_sk
from frictionjax.frequency.second_order import Lines, iterate, start

ARM = {"J": 0.03, "stiffness": 2000.0, "damping": 8.0, "motor_constant": 16.0}
TABLE_I = {"J": 1.0, "stiffness": 1e5, "damping": 316.6, "motor_constant": 1.0}
STIFF = {"J": 0.01, "stiffness": 1e6, "damping": 10.0, "motor_constant": 1.0}
SMALL = {"J": 1e-8, "stiffness": 1e-3, "damping": 1e-6, "motor_constant": 1.0}
OVERDAMPED = {"J": 1.0, "stiffness": 1e5, "damping": 2000.0, "motor_constant": 1.0}
REVERSED = {"J": 0.03, "stiffness": 2000.0, "damping": 4.0, "motor_constant": -16.0}


def _discrete(plant, rate):
    """Exact difference equation of the plant behind a zero-order hold."""
    numerator, denominator, _ = cont2discrete(
        ([plant["motor_constant"]], [plant["J"], plant["damping"], plant["stiffness"]]), 1.0 / rate
    )
    return numerator[0], denominator


def _exact(plant, rate, *, delay=0.0, hold=True, lines=2049):
    """The response without noise, with an uncertainty of 0.1 % to weight it."""
    f = np.linspace(0.0, rate / 2.0, lines)
    s = 2j * np.pi * f
    if hold:
        response = freqz(*_discrete(plant, rate), worN=f, fs=rate)[1]
    else:
        response = plant["motor_constant"] / (plant["J"] * s**2 + plant["damping"] * s + plant["stiffness"])
    response = jnp.asarray(response * np.exp(-s * delay))
    one = jnp.asarray(1.0)
    return FRF(
        jnp.asarray(f), response, jnp.ones(lines), 1e-3 * jnp.abs(response), 40.0 * one, rate * one, one
    )


def _of_one_size(plant, rate, band):
    """The response without noise on as many lines as leave 303 in the band, those of ARM at 2 kHz from 2 to 150 Hz:
    each number of lines is a program."""
    for lines in range(304, 20_000):
        f = np.linspace(0.0, rate / 2.0, lines)
        if np.count_nonzero((f >= band[0]) & (f <= band[1])) == 303:
            return _exact(plant, rate, lines=lines)
    raise AssertionError(f"no number of lines leaves 303 from {band[0]} to {band[1]} Hz")


def _noisy(plant, rate, n, noise, seed):
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], n)
    x = lfilter(*_discrete(plant, rate), u)
    return u, x + noise * x.std() * rng.standard_normal(n)


@pytest.mark.parametrize(
    ("plant", "rate", "band", "tolerance"),
    [
        (ARM, 2000.0, (2.0, 150.0), 1e-7),
        (ARM, 10_000.0, (0.0, 150.0), 1e-7),
        (ARM, 2000.0, (2.0, 1000.0), 1e-4),
        (TABLE_I, 10_000.0, (3.0, 150.0), 1e-7),
        (STIFF, 10_000.0, (1.0, 500.0), 1e-5),
        (STIFF, 10_000.0, (1000.0, 3000.0), 1e-5),
        (SMALL, 2000.0, (2.0, 150.0), 1e-7),
        (OVERDAMPED, 10_000.0, (2.0, 150.0), 1e-6),
        (REVERSED, 2000.0, (2.0, 150.0), 1e-7),
    ],
)
def test_a_held_second_order_system_is_recovered(plant, rate, band, tolerance):
    frf = _of_one_size(plant, rate, band)
    sk = fit_sk(frf, band, motor_constant=plant["motor_constant"])
    assert sk.converged
    for name in ("J", "stiffness", "damping"):
        assert getattr(sk, name).value == pytest.approx(plant[name], rel=tolerance)
    root = np.sqrt(plant["stiffness"] * plant["J"])
    assert sk.natural_frequency.value == pytest.approx(root / plant["J"] / (2.0 * np.pi), rel=tolerance)
    assert sk.damping_ratio.value == pytest.approx(0.5 * plant["damping"] / root, rel=tolerance)
    assert sk.frequency.shape == sk.response.shape
    assert sk.frequency.size == 303
    inside = np.flatnonzero(np.isin(frf.frequency, sk.frequency))
    exact = np.asarray(frf.response)[inside]
    np.testing.assert_allclose(sk.response, exact, rtol=1e-3)


def test_without_a_hold_the_continuous_response_is_recovered():
    sk = fit_sk(_exact(ARM, 2000.0, hold=False), (2.0, 150.0), motor_constant=16.0, hold=False)
    for name in ("J", "stiffness", "damping"):
        assert getattr(sk, name).value == pytest.approx(ARM[name], rel=1e-9)
    # With the wrong assumption, half a sample of lead is read as less damping: stiffness times the lead.
    wrong = fit_sk(_exact(ARM, 2000.0, hold=False), (2.0, 20.0), motor_constant=16.0)
    assert wrong.damping.value == pytest.approx(8.0 - 2000.0 / 4000.0, abs=0.1)


@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.002, 0.006])
def test_a_delay_is_fitted_beside_the_rest(delay):
    frf = _exact(ARM, 2000.0, delay=delay)
    sk = fit_sk(frf, (2.0, 150.0), motor_constant=16.0, fit_delay=True)
    assert sk.converged
    assert sk.warnings == ()
    assert sk.delay.value == pytest.approx(delay, abs=1e-9)
    assert sk.delay.unit == "s"
    assert sk.damping.value == pytest.approx(8.0, rel=1e-6)
    without = fit_sk(frf, (2.0, 150.0), motor_constant=16.0)
    assert (without.delay.value, without.delay.stderr) == (0.0, 0.0)
    assert bool(without.warnings) == (delay > 0.0)


@pytest.mark.parametrize(
    ("segment", "n", "fit_delay"), [(4096, 65_536, False), (4096, 16_384, False), (4096, 65_536, True)]
)
def test_the_standard_errors_cover_the_truth(segment, n, fit_delay):
    """Estimates of sixty records scatter about the truth as their standard errors say, with many averages and few."""
    names, z = ["J", "stiffness", "damping", *(["delay"] if fit_delay else [])], []
    truth = {**ARM, "delay": 0.0}
    misfit = []
    for seed in range(60):
        frf = estimate_frf(*_noisy(ARM, 2000.0, n, 0.5, seed), 2000.0, segment=segment)
        sk = fit_sk(frf, (2.0, 150.0), motor_constant=16.0, fit_delay=fit_delay)
        assert sk.converged
        assert not any("misfit" in warning for warning in sk.warnings)
        z.append([(getattr(sk, name).value - truth[name]) / getattr(sk, name).stderr for name in names])
        misfit.append(sk.misfit)
    z = np.array(z)
    # A mean beyond 4.5 standard errors, or a sum of squares outside its 1e-5 quantiles, is no accident.
    assert np.all(np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(60.0))
    assert np.all(np.sum(z**2, axis=0) > chi2.ppf(1e-5, 60))
    assert np.all(np.sum(z**2, axis=0) < chi2.ppf(1.0 - 1e-5, 60))
    assert abs(np.mean(misfit) - 1.0) < 5.0 * np.std(misfit) / np.sqrt(60.0)


def test_derived_errors_follow_from_the_scatter():
    """Natural frequency and damping ratio carry errors by the delta method: two roads to one number."""
    found = []
    for seed in range(60):
        frf = estimate_frf(*_noisy(ARM, 2000.0, 32_768, 0.3, seed), 2000.0, segment=4096)
        found.append(fit_sk(frf, (2.0, 150.0), motor_constant=16.0))
    for name in ("natural_frequency", "damping_ratio"):
        scatter = np.std([getattr(sk, name).value for sk in found], ddof=1)
        told = np.mean([getattr(sk, name).stderr for sk in found])
        assert told == pytest.approx(scatter, rel=5.0 / np.sqrt(2.0 * 59.0))


def test_the_residual_falls_and_ends_below_the_first_linear_solution():
    frf = estimate_frf(*_noisy(ARM, 2000.0, 65_536, 1.0, 3), 2000.0, segment=4096)
    sk = fit_sk(frf, (2.0, 150.0), motor_constant=16.0)
    assert np.all(np.diff(sk.residual_norm) <= 0.0)
    assert sk.residual_norm[-1] < sk.residual_norm[0]
    assert sk.message == f"Converged after {sk.residual_norm.size - 1} steps."
    stopped = fit_sk(frf, (2.0, 150.0), motor_constant=16.0, max_steps=1)
    assert not stopped.converged
    assert "raise `max_steps`" in stopped.message
    assert any("did not converge" in warning for warning in stopped.warnings)


def test_noise_in_the_response_leaves_no_bias():
    """What the iteration of 1963 alone does not manage: at this noise its stiffness is off by many standard errors."""
    rng = np.random.default_rng(5)
    exact = _exact(ARM, 2000.0)
    spread = 0.3 * float(jnp.abs(exact.response[0]))
    found = []
    for _ in range(40):
        noise = spread * (rng.standard_normal(2049) + 1j * rng.standard_normal(2049))
        frf = eqx.tree_at(
            lambda f: (f.response, f.std), exact, (exact.response + noise, jnp.full(2049, spread))
        )
        found.append(fit_sk(frf, (2.0, 150.0), motor_constant=16.0))
    z = np.array([(sk.stiffness.value - 2000.0) / sk.stiffness.stderr for sk in found])
    assert abs(z.mean()) < 4.5 / np.sqrt(40.0)
    assert 0.6 < z.std() < 1.5


@pytest.mark.parametrize("machine", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("input_unit", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("time", [1e-3, 1e3])
def test_units_of_any_size_change_nothing(machine, input_unit, time):
    exact = _exact(ARM, 2000.0)
    scaled = eqx.tree_at(
        lambda f: (f.response, f.std, f.frequency, f.sample_rate),
        exact,
        (
            exact.response * (input_unit / machine),
            exact.std * (input_unit / machine),
            exact.frequency / time,
            exact.sample_rate / time,
        ),
    )
    sk = fit_sk(scaled, (2.0 / time, 150.0 / time), motor_constant=16.0 * input_unit)
    assert sk.converged
    assert sk.warnings == ()
    for name, power in (("J", 2), ("stiffness", 0), ("damping", 1)):
        assert getattr(sk, name).value / machine / time**power == pytest.approx(ARM[name], rel=1e-7)
        assert getattr(sk, name).stderr / machine / time**power < 0.01 * ARM[name]


def _with_noise(exact, response, relative, seed=0):
    rng = np.random.default_rng(seed)
    spread = relative * np.abs(response)
    noise = spread * (rng.standard_normal(2049) + 1j * rng.standard_normal(2049))
    return eqx.tree_at(
        lambda f: (f.response, f.std), exact, (jnp.asarray(response + noise), jnp.asarray(spread))
    )


@pytest.mark.parametrize(("mode", "share"), [(260.0, 0.1), (260.0, 0.5), (200.0, 0.3)])
def test_a_mode_above_the_band_is_reported_as_misfit_and_a_narrower_band_mends_it(mode, share):
    exact = _exact(ARM, 2000.0)
    s, w = 2j * np.pi * np.asarray(exact.frequency), 2.0 * np.pi * mode
    response = np.asarray(exact.response) * (1.0 - share * s**2 / (s**2 + 0.06 * w * s + w**2))
    frf = _with_noise(exact, response, 0.003)
    wide, narrow = (fit_sk(frf, (2.0, top), motor_constant=16.0) for top in (150.0, 60.0))
    assert wide.converged
    assert narrow.converged
    assert any("misfit" in warning for warning in wide.warnings)
    for name in ("J", "stiffness", "damping"):
        off = [abs(getattr(sk, name).value / ARM[name] - 1.0) for sk in (wide, narrow)]
        assert off[1] < 0.02
        # More than the standard errors say: this is why there is a warning.
        if name != "damping":
            assert off[1] < off[0]
            assert off[0] > 3.0 * getattr(wide, name).stderr / ARM[name]


_start = eqx.filter_jit(start)


def test_noise_above_the_response_gives_numbers_or_a_sentence_and_no_nan():
    """Noise of twice the static response on every bin: linear starts that are unstable, and fits that may end so."""
    exact = _exact(ARM, 2000.0)
    spread = 2.0 * float(jnp.abs(exact.response[0]))
    inside = (np.asarray(exact.frequency) >= 2.0) & (np.asarray(exact.frequency) <= 150.0)
    omega = 2.0 * np.pi * np.asarray(exact.frequency)[inside]
    unstable, recovered = 0, 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        noise = spread * (rng.standard_normal(2049) + 1j * rng.standard_normal(2049))
        frf = eqx.tree_at(
            lambda f: (f.response, f.std), exact, (exact.response + noise, jnp.full(2049, spread))
        )
        response = np.asarray(frf.response)[inside]
        size = np.max(np.abs(response))
        lines = Lines(
            jnp.asarray(omega / omega[-1]),
            jnp.asarray(response / size),
            jnp.asarray(np.full(omega.size, size / spread)),
            jnp.asarray(4000.0 * np.pi / omega[-1]),
        )
        if np.min(np.asarray(_start(lines, jnp.asarray(0.0), True))[:3]) > 0.0:
            continue
        unstable += 1
        sk = fit_sk(frf, (2.0, 150.0), motor_constant=16.0)
        assert np.all(np.isfinite(sk.residual_norm))
        for name in ("J", "stiffness", "damping", "natural_frequency", "damping_ratio"):
            assert np.isfinite(getattr(sk, name).value)
        if min(sk.J.value, sk.stiffness.value, sk.damping.value) > 0.0:
            recovered += abs(sk.stiffness.value - 2000.0) < 4.5 * sk.stiffness.stderr
        else:
            assert any(warning.startswith("negative ") for warning in sk.warnings)
    assert unstable >= 5
    assert recovered >= unstable / 2


def test_unrelated_signals_are_refused():
    rng = np.random.default_rng(0)
    for _ in range(20):
        frf = estimate_frf(*rng.standard_normal((2, 32_768)), 2000.0, segment=2048)
        with pytest.raises(InputError, match=r"no more than unrelated signals show .* aligned in time"):
            fit_sk(frf, (2.0, 150.0))
    u = rng.standard_normal(32_768)
    with pytest.raises(InputError, match="the output does not answer the input anywhere"):
        fit_sk(estimate_frf(u, np.zeros(32_768), 2000.0, segment=2048), (2.0, 150.0))
    zero = eqx.tree_at(lambda f: f.coherence, _exact(ARM, 2000.0), jnp.zeros(2049))
    with pytest.raises(InputError, match=r"the coherence from 2\.0 to 150\.0 Hz is 0"):
        fit_sk(zero, (2.0, 150.0))
    # A coherence of a few per cent, of many averages, is a response: it is fitted, however roughly.
    weak = estimate_frf(*_noisy(ARM, 2000.0, 2**19, 5.0, 1), 2000.0, segment=2048)
    inside = (np.asarray(weak.frequency) > 2.0) & (np.asarray(weak.frequency) < 150.0)
    assert np.mean(np.asarray(weak.coherence)[inside]) < 0.6
    sk = fit_sk(weak, (2.0, 150.0), motor_constant=16.0)
    assert abs(sk.stiffness.value - 2000.0) < 4.5 * sk.stiffness.stderr < 400.0


def test_units_and_signs_of_what_is_found():
    sk = fit_sk(
        _exact(ARM, 2000.0), (2.0, 150.0), motor_constant=16.0, units={"force": "N*m", "position": "rad"}
    )
    assert isinstance(sk, SKResult)
    assert (sk.J.unit, sk.stiffness.unit, sk.damping.unit) == ("N*m*s^2/rad", "N*m/rad", "N*m*s/rad")
    assert (sk.natural_frequency.unit, sk.damping_ratio.unit) == ("Hz", "1")
    assert all(e.identified for e in (sk.J, sk.stiffness, sk.damping, sk.natural_frequency, sk.damping_ratio))
    assert sk.warnings == ()
    # Without a motor constant, everything is per unit of it.
    bare = fit_sk(_exact(ARM, 2000.0), (2.0, 150.0))
    assert 16.0 * bare.J.value == pytest.approx(sk.J.value, rel=1e-9)
    assert bare.damping.unit == "force*s/position"


def test_what_a_band_does_not_hold_is_said():
    exact = _exact(ARM, 2000.0)
    turned = eqx.tree_at(lambda f: f.response, exact, -exact.response)
    negative = fit_sk(turned, (2.0, 150.0), motor_constant=16.0)
    for name in ("J", "stiffness", "damping"):
        assert any(warning.startswith(f"negative {name}: ") for warning in negative.warnings)
        assert not getattr(negative, name).identified
    assert any("give `motor_constant` the other sign" in warning for warning in negative.warnings)
    assert (negative.natural_frequency.value, negative.natural_frequency.stderr) == (0.0, np.inf)
    assert not negative.damping_ratio.identified
    outside = fit_sk(exact, (2.0, 20.0), motor_constant=16.0)
    assert any("outside the band" in warning for warning in outside.warnings)
    # A spring at low frequency tells nothing of the inertia.
    vague = eqx.tree_at(lambda f: f.std, exact, 100.0 * exact.std)
    spring = fit_sk(vague, (2.0, 8.0), motor_constant=16.0)
    assert not spring.J.identified
    assert spring.stiffness.identified
    assert any("J" in warning and "not determined" in warning for warning in spring.warnings)
    few = eqx.tree_at(lambda f: f.averages_effective, exact, jnp.asarray(2.0))
    assert any("independent segments" in warning for warning in fit_sk(few, (2.0, 150.0)).warnings)
    resonant = eqx.tree_at(
        lambda f: f.response,
        exact,
        exact.response * (1.0 + 0.05j * np.cos(0.1 * np.asarray(exact.frequency))),
    )
    assert any("misfit" in warning for warning in fit_sk(resonant, (2.0, 150.0)).warnings)


def test_lines_without_power_do_not_count():
    exact = _exact(ARM, 2000.0)
    odd = jnp.arange(2049) % 2 == 1
    with_gaps = eqx.tree_at(
        lambda f: (f.response, f.std),
        exact,
        (jnp.where(odd, exact.response, jnp.zeros_like(exact.response)), jnp.where(odd, exact.std, jnp.inf)),
    )
    sk = fit_sk(with_gaps, (2.0, 150.0), motor_constant=16.0)
    assert sk.J.value == pytest.approx(0.03, rel=1e-6)
    assert sk.frequency.size < 0.6 * fit_sk(exact, (2.0, 150.0)).frequency.size


def test_new_numbers_compile_nothing_new(monkeypatch):
    counted = eqx.filter_jit(eqx.debug.assert_max_traces(iterate, max_traces=1))
    monkeypatch.setattr("frictionjax.frequency.sanathanan_koerner.iterate", counted)
    for plant, band in ((ARM, (2.0, 150.0)), (TABLE_I, (3.0, 149.0)), (REVERSED, (2.5, 140.0))):
        assert fit_sk(
            _exact(plant, 2000.0), band, motor_constant=plant["motor_constant"], max_steps=37
        ).converged


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"band": (50.1, 50.2)}, "holds 0 bins"),
        ({"band": (150.0, 2.0)}, "Widen it; the bins are 0.4883 Hz apart"),
        ({"band": (1.0, 2.5)}, "holds 3 bins"),
        ({"motor_constant": 0.0}, "`motor_constant`"),
        ({"max_steps": 0}, "`max_steps`"),
    ],
)
def test_bad_arguments_are_refused_with_a_cure(change, words):
    with pytest.raises(InputError, match=words):
        fit_sk(_exact(ARM, 2000.0), **{"band": (2.0, 150.0), **change})


def test_a_batch_is_refused_with_a_cure():
    u = np.random.default_rng(0).standard_normal((2, 4096))
    batch = jax.vmap(lambda u: estimate_frf(u, u, 2000.0, segment=512))(u)
    with pytest.raises(InputError, match="one response at a time"):
        fit_sk(batch, (2.0, 150.0))


def test_float32_is_refused():
    frf = _exact(ARM, 2000.0)
    with jax.enable_x64(False), pytest.raises(PrecisionError):
        fit_sk(frf, (2.0, 150.0))
