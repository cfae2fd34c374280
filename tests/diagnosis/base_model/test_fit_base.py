"""The parameters that a diagnosis states are those that `fit` states of the same recordings."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, base_fit, break_away, large_noise, open_loop, stick_noise, truth

import frictionjax as fj
from frictionjax.diagnosis.base_model.fit_base import parameters_of

FORCE = 1e-3
"""Unmeasured, rms over Coulomb friction: innovations of a fixed observer are correlated by it."""
UNITS = {"force": "N*m", "position": "rad", "input": "V"}


@pytest.fixture(scope="module")
def recordings():
    rng = np.random.default_rng(5)
    volt = float(PLANT.friction.Fc) / float(PLANT.motor_constant)

    def pushed(name, u, seed):
        moved = open_loop(name, u + FORCE * volt * rng.standard_normal(len(u)), seed=seed)
        return dataclasses.replace(moved, u=np.asarray(u))

    return (
        pushed("stick", stick_noise(4.0), 1),
        pushed("ramps", break_away(), 2),
        pushed("loud", large_noise(4.0), 3),
    )


def test_a_diagnosis_states_what_a_fit_states(recordings):
    """From where the descent of its observers ended, and from the truth; of the integration a fit keeps an error."""
    model = base_fit((PLANT,), recordings)
    stated = parameters_of(model, UNITS)
    fitted = fj.fit(PLANT, recordings, encoder_step=FINE, progress=False).parameters
    descended = parameters_of(model, UNITS, lacking=True)
    for name, value in truth(PLANT).items():
        own, other = stated[name], fitted[name]
        assert abs(own.value - other.value) < 1.5 * other.stderr, name
        assert own.stderr == pytest.approx(other.stderr, rel=0.3), name
        assert abs(own.value - value) < 4.0 * own.stderr, name
    # Those of the descent are larger, most of them severalfold: its innovations are no white noise.
    assert np.median([descended[name].stderr / stated[name].stderr for name in stated]) > 2.0
