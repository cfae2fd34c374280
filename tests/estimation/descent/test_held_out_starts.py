"""Starting deflections of held-out recordings: they do not stay where other parameters once led them."""

import numpy as np
import pytest
import scipy
from helpers_estimation import FINE, PLANT, RATE, VOLT, open_loop, stick_noise

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent import robust
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.estimation.parameters import changed


@pytest.fixture(scope="module")
def astray():
    """A machine at rest for a second before it moves, held out, its bristle bent far, all else being true."""
    u = np.concatenate([np.zeros(2000), 0.5 * VOLT * np.sin(2.0 * np.pi * 1.0 * np.arange(3000) / RATE)])
    recordings = (
        open_loop("stick", stick_noise(), seed=1, noise=1e-7, substeps=4),
        open_loop("rest", u, seed=2, role="holdout", noise=1e-7, substeps=4),
    )
    batch = make_batch(recordings, encoder_step=FINE).with_substeps(4)
    posterior, vector = robust_posterior(PLANT, batch, np.array([False, True]))
    return posterior.at_bandwidth(SLOW_BANDWIDTH), changed(vector, -1, -0.55)


def _left(found):
    return float(np.median(np.asarray(found.near.powers[0])[1, :20]))


@pytest.mark.untyped
def test_a_deflection_that_went_astray_comes_back(astray, monkeypatch):
    found = robust.descend(*astray, graduate=False)
    assert abs(found.vector[-1]) < 0.01 and _left(found) < 1.5
    with monkeypatch.context() as patched:
        patched.setattr(robust, "_unbent", lambda end: None)
        alone = robust.descend(*astray, graduate=False)
    assert _left(alone) > 10.0
    # It determines no parameter.
    assert found.misfit == pytest.approx(alone.misfit, abs=1e-4)


@pytest.mark.untyped
def test_one_that_is_right_is_not_descended_to_again(astray, monkeypatch):
    posterior, vector = astray
    right = robust.descend(posterior, changed(vector, -1, 0.0), graduate=False)
    found, _unbent = [], robust._unbent
    monkeypatch.setattr(robust, "_unbent", lambda end: found.append(_unbent(end)) or found[-1])
    robust.descend(posterior, right.vector, graduate=False)
    robust.descend(posterior, right.vector, graduate=False, steps=0)
    assert found == [None]


@pytest.mark.untyped
@pytest.mark.parametrize(("nats", "again"), [(0.8, False), (1.3, True)])
def test_less_than_a_nat_is_no_reason_to_descend_again(astray, nats, again):
    """What the bend of a true model costs grows with its square."""
    posterior, vector = astray
    right = changed(vector, -1, 0.0)

    def left(bend):
        power = np.asarray(posterior.powers([changed(right, -1, bend)])[0])
        return float(np.sum(losses_of(power, posterior.batch), axis=1)[1])

    bend = scipy.optimize.brentq(lambda one: left(one) - left(0.0) - nats, 1e-6, 0.1)
    there = changed(right, -1, bend)
    end = robust._place(posterior, there, posterior.evaluated(there), 2e-3)
    assert (robust._unbent(end) is not None) == again
