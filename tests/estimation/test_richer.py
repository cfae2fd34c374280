"""A model with an effect more, started where the poorer one ended, is at least as likely: whatever the sensor."""

import dataclasses

import numpy as np
import pytest
from helpers_fit import FINE, NEAR, experiment, fit_near
from helpers_plants import effect

from frictionjax.estimation.descent.round import SAME_COST

COARSE = 3e-4
"""Step of an encoder, rad: the break-away deflection."""
ALLOWED = 0.02
"""Nats a sample between two minima under a coarse encoder, whose error is no white noise."""


@pytest.fixture(scope="module", params=[FINE, COARSE], ids=["fine", "coarse"])
def poorer(request):
    """Recordings with an encoder, its step, and the base model fitted to them."""
    step = request.param
    recordings = experiment(3)
    if step == COARSE:
        recordings = tuple(
            dataclasses.replace(one, x=step * np.round(np.asarray(one.x) / step)) for one in recordings
        )
    return recordings, step, fit_near(recordings, NEAR, encoder_step=step)


@pytest.mark.parametrize("name", ["QuadraticDrag", "DriveDeadzone"])
def test_a_richer_model_ends_no_higher(poorer, name):
    recordings, step, base = poorer
    silent = effect(name).silenced()
    richer = fit_near(recordings, base.drive.with_effects(silent), encoder_step=step)
    samples = sum(one.x.size for one in recordings)
    allowed = SAME_COST if step == FINE else ALLOWED * samples
    assert richer.cost < base.cost + allowed
