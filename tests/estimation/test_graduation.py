"""The scale of the loss comes down in stages (`GRADUATION`): the truth is found from where it is not in sight."""

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, experiment, truth

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import robust_posterior


def test_a_start_that_is_far_off_comes_down_in_stages():
    """Every coordinate off, most of them by a factor of two: with the scale of the loss at the median power from the
    start two of these starts end at another minimum, and with the scale at the noise one does."""
    batch = make_batch(experiment(), encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(4, bool))
    off = 0.7 * np.random.default_rng(5).standard_normal((4, vector.size))
    off[:, posterior.parameters :] = 0.0
    for start in vector + off:
        found = descend(posterior, start)
        assert found.misfit < 0.015
        assert truth(posterior.drive_of(found.vector)) == pytest.approx(truth(PLANT), rel=0.03)
