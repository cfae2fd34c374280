"""`fit_many` is `fit`, many at once."""

import dataclasses

import numpy as np
import pytest
from helpers_fit import FINE, NOISE, PUSH, TRUTH, experiment, fit_near, other_start

from frictionjax.core import InputError
from frictionjax.estimation import fit_many

SETS = 8
LABELS = list(TRUTH)


@pytest.fixture(scope="module")
def sets():
    return [experiment(seed) for seed in range(SETS)]


@pytest.fixture(scope="module")
def found(sets):
    rng = np.random.default_rng(2)
    starts = [other_start({n: 1.2 ** rng.uniform(-1, 1) for n in LABELS if n != "Fs"}) for _ in range(SETS)]
    return fit_many(starts, sets, encoder_step=FINE)


def test_the_truth_is_recovered_by_each(found):
    """56 errors over their standard errors: rms 1 within four of its own standard errors (1/sqrt 112)."""
    assert list(found.names) == LABELS
    z = (found.values - np.array(list(TRUTH.values()))) / found.stderr
    assert np.max(np.abs(z)) < 5.0
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * z.size))
    assert np.all(np.isfinite(found.cost))


def test_noise_is_found_in_each(found):
    np.testing.assert_allclose(found.position, NOISE, rtol=0.15)
    assert np.all(np.abs(np.log(np.median(found.push, axis=0) / PUSH)) < np.log(1.6))


def test_it_is_the_same_estimator_as_fit(found, sets):
    alone = fit_near(sets[0])
    values, stderr = (
        np.array([getattr(alone.parameters[n], kind) for n in LABELS]) for kind in ("value", "stderr")
    )
    assert np.max(np.abs(found.values[0] - values) / stderr) < 0.3
    np.testing.assert_allclose(found.stderr[0], stderr, rtol=0.1)
    value, error = found.of("Fc")
    assert value[0] == found.values[0, LABELS.index("Fc")] and error[0] == found.stderr[0, LABELS.index("Fc")]


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
