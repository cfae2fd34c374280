"""`fit_many` is `fit`, many at once."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_fit import FINE, NOISE, PUSH, TRUTH, experiment, fit_near, other_start

from frictionjax.core import InputError
from frictionjax.estimation import fit_many
from frictionjax.estimation.descent.replicated import Found
from frictionjax.estimation.evidence import Noise
from frictionjax.estimation.fit_many import _doubtful, _keep_better, _replicas

SETS = 8
LABELS = list(TRUTH)


@pytest.fixture(scope="module")
def sets():
    return [experiment(seed) for seed in range(SETS)]


@pytest.fixture(scope="module")
def starts():
    rng = np.random.default_rng(2)
    return [other_start({n: 1.2 ** rng.uniform(-1, 1) for n in LABELS if n != "Fs"}) for _ in range(SETS)]


@pytest.fixture(scope="module")
def found(starts, sets):
    return fit_many(starts, sets, encoder_step=FINE)


@pytest.mark.slow
def test_the_truth_is_recovered_by_each(found):
    """56 errors over their standard errors: rms 1 within four of its own standard errors (1/sqrt 112)."""
    assert list(found.names) == LABELS
    z = (found.values - np.array(list(TRUTH.values()))) / found.stderr
    assert np.max(np.abs(z)) < 5.0
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * z.size))
    assert np.all(np.isfinite(found.cost))


@pytest.mark.slow
def test_noise_is_found_in_each(found):
    np.testing.assert_allclose(found.position, NOISE, rtol=0.15)
    assert np.all(np.abs(np.log(np.median(found.push, axis=0) / PUSH)) < np.log(1.6))


@pytest.mark.slow
def test_it_is_the_same_estimator_as_fit(found, starts, sets):
    """From the same starts, or others: the same minimum, within a small part of a standard error."""
    for place in range(3):
        alone = fit_near(sets[place], starts[place])
        values, stderr = (
            np.array([getattr(alone.parameters[n], kind) for n in LABELS]) for kind in ("value", "stderr")
        )
        assert np.max(np.abs(found.values[place] - values) / stderr) < 0.05
        np.testing.assert_allclose(found.stderr[place], stderr, rtol=0.02)
        assert found.cost[place] == pytest.approx(alone.cost, abs=0.5)
        assert found.converged[place] == alone.success
    value, error = found.of("Fc")
    assert value[0] == found.values[0, LABELS.index("Fc")] and error[0] == found.stderr[0, LABELS.index("Fc")]


@pytest.mark.slow
def test_sets_side_by_side_are_fitted_as_one_by_one(found, starts, sets, monkeypatch):
    """As on a GPU, which takes all sets at once: those that have ended wait for the others."""
    monkeypatch.setitem(fit_many.__globals__, "_LANES", 3)
    together = fit_many(starts[:3], sets[:3], encoder_step=FINE)
    np.testing.assert_allclose(together.values, found.values[:3], rtol=1e-5)
    np.testing.assert_allclose(together.cost, found.cost[:3], atol=0.1)


def ends(costs, values, converged=True):
    """Ends of fits with these costs, and these values of their only parameter."""
    d = len(costs)
    values, square = np.array(values, dtype=float)[:, None], np.ones((d, 1, 1))
    noise = Noise(np.ones((d, 1)), np.ones((d, 1)), np.ones((d, 1)))
    done, moved = np.broadcast_to(np.asarray(converged), d).copy(), np.zeros(d)
    known, ended = (values, square, square.copy(), square.copy()), np.zeros((d, 1), bool)
    return Found(values.copy(), *known, ended, noise, np.array(costs), moved, done)


def test_a_set_unlike_the_others_is_doubted():
    costs, values = np.linspace(-101.0, -99.0, 9), np.linspace(0.99, 1.01, 9)
    assert _doubtful(ends(costs, values)).size == 0
    for spoil in (
        {"costs": -50.0},
        {"costs": np.nan},
        {"values": 1.5},
        {"values": np.nan},
        {"converged": False},
    ):
        numbers = {"costs": costs.copy(), "values": values.copy(), "converged": np.ones(9, bool)}
        for name, value in spoil.items():
            numbers[name][4] = value
        assert _doubtful(ends(**numbers)).tolist() == [4], spoil


def test_of_two_ends_the_likelier_one_is_kept():
    """Whatever a fit that is made again comes to: a lost one replaces none, and any one replaces a lost one."""
    found, places = ends([-1.0, -2.0, -3.0, np.nan], [1.0, 2.0, 3.0, 4.0]), np.array([0, 1, 3])
    _keep_better(found, ends([-0.5, -9.0, -7.0], [10.0, 20.0, 40.0]), places)
    assert found.values[:, 0].tolist() == [1.0, 20.0, 3.0, 40.0]
    assert found.cost.tolist() == [-1.0, -9.0, -3.0, -7.0]
    _keep_better(found, ends([np.nan], [99.0]), np.array([2]))
    assert found.values[2, 0] == 3.0


def test_what_a_set_does_not_determine_has_no_error():
    """As in `fit`: at the end of a range, and where a derivative is not finite."""
    found = ends([-1.0, -2.0, -3.0], [1.0, 2.0, 3.0])
    found.at_end[1], found.hessian[2] = True, np.nan
    layout = (SimpleNamespace(label="Fc"),)
    posterior = SimpleNamespace(constraints=SimpleNamespace(layout=layout), prior=np.array([1e-9]))
    assert _replicas(found, posterior).of("Fc")[1].tolist() == [1.0, np.inf, np.inf]


def test_sets_of_two_shapes_are_refused(sets):
    short = [dataclasses.replace(one, u=one.u[:-500], x=one.x[:-500]) for one in sets[1]]
    with pytest.raises(
        InputError, match=r"set 1 has recordings of .* samples, the first .*fit them one by one"
    ):
        fit_many(other_start({}), [sets[0], short], encoder_step=FINE)


def test_nothing_to_fit_is_refused():
    with pytest.raises(InputError, match="there is no data set"):
        fit_many(other_start({}), [])


def test_as_many_starts_as_sets(sets):
    with pytest.raises(InputError, match=r"2 starts for 3 sets.*Give one, or one each"):
        fit_many([other_start({})] * 2, sets[:3], encoder_step=FINE)
