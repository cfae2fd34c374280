"""Profile likelihood and bootstrap against the standard errors of the fit: three roads to one uncertainty."""

import equinox as eqx
import jax
import numpy as np
import pytest
from helpers_fit import TRUTH, experiment, fit_near

from frictionjax.core import InputError
from frictionjax.estimation import bootstrap, profile_likelihood

DRAWS = 40


@pytest.fixture(scope="module")
def fitted():
    return fit_near(experiment())


@pytest.fixture(scope="module")
def redrawn(fitted):
    reported = []
    found = bootstrap(
        fitted, DRAWS, jax.random.key(1), piece=20, progress=lambda _, part: reported.append(part)
    )
    assert reported == [0.5, 1.0]
    return found


@pytest.fixture
def read_from_file(fitted):
    return eqx.tree_at(lambda r: (r.posterior, r.vector), fitted, (None, None))


def _white(result, name):
    place = result.names.index(name)
    return float(np.sqrt(result.covariance_white[place, place]))


@pytest.mark.parametrize(
    "name", ["J", pytest.param("sigma0", marks=pytest.mark.slow), pytest.param("Fc", marks=pytest.mark.slow)]
)
def test_near_the_optimum_the_profile_is_the_parabola_of_the_standard_error(fitted, name):
    found, spread = profile_likelihood(fitted, name), _white(fitted, name)
    z = (found.values - found.value) / spread
    np.testing.assert_allclose(np.sqrt(found.deviance), np.abs(z), rtol=0.12)
    low, high = found.interval()
    assert high - found.value == pytest.approx(1.96 * spread, rel=0.12)
    assert found.value - low == pytest.approx(1.96 * spread, rel=0.12)
    assert found.interval(0.68)[1] < high


def test_an_interval_that_is_not_reached_is_infinite(fitted):
    value, spread = fitted.parameters["J"].value, _white(fitted, "J")
    # As many values as by default: each number of them is a program.
    found = profile_likelihood(fitted, "J", values=value + spread * np.linspace(-3.0, 0.5, 8))
    low, high = found.interval()
    assert np.isfinite(low) and high == np.inf


def test_refits_of_drawn_data_scatter_as_the_standard_errors_say(fitted, redrawn):
    """A standard deviation of 40 draws is known to 11 %: four of these are allowed."""
    for name in fitted.names:
        assert redrawn.stderr[name] == pytest.approx(_white(fitted, name), rel=0.45), name
        mean = redrawn.bias[name] / (redrawn.stderr[name] / np.sqrt(DRAWS))
        assert abs(mean) < 4.0, name
    correlation = np.corrcoef(redrawn.values, rowvar=False)
    np.testing.assert_allclose(np.diag(redrawn.covariance), np.var(redrawn.values, axis=0, ddof=1))
    assert np.max(np.abs(correlation - np.eye(len(correlation)))) > 0.3  # sigma2, Fc and vs trade


def test_a_bootstrap_interval_is_as_wide_as_the_scatter(redrawn):
    for name in ("J", "sigma0", "Fc"):
        low, high = redrawn.interval(name, 0.9)
        assert high - low == pytest.approx(2.0 * 1.645 * redrawn.stderr[name], rel=0.4)
        assert abs(0.5 * (low + high) - TRUTH[name]) < 5.0 * redrawn.stderr[name]


def test_other_keys_draw_other_data(fitted):
    first, second = (bootstrap(fitted, 20, jax.random.key(k), piece=20).values for k in (1, 2))
    assert not np.any(first == second)


@pytest.mark.parametrize(
    "verb", [lambda r: profile_likelihood(r, "J"), lambda r: bootstrap(r, 4, jax.random.key(0))]
)
def test_a_result_from_a_file_has_no_data(read_from_file, verb):
    with pytest.raises(
        InputError, match=r"needs the data of the fit.*Fit again, from the drive of this result"
    ):
        verb(read_from_file)


def test_a_parameter_that_was_not_free(fitted):
    with pytest.raises(InputError, match=r"`mass` was not free in this fit.*Choose from J, sigma0"):
        profile_likelihood(fitted, "mass")


def test_one_draw_is_no_scatter(fitted):
    with pytest.raises(InputError, match=r"`draws` is 1.*Two are the least"):
        bootstrap(fitted, 1, jax.random.key(0))
