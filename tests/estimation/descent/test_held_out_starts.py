"""Starting deflections of held-out recordings: they do not stay where other parameters once led them."""

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, VOLT, open_loop, stick_noise

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent import robust
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
