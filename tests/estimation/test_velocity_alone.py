"""Recordings of a velocity alone: `fit` finds the machine, the offset of the sensor and its noise."""

import numpy as np
import pytest
from helpers_fit import PLANT, RATE, SAMPLES, SUBSTEPS, TRUTH, VOLT, other_start, ramps_input

from frictionjax.estimation import fit
from frictionjax.exchange.fit_file import fit_from_json, fit_to_json
from frictionjax.physics import VelocityOffset
from frictionjax.recordings import Recording
from frictionjax.recordings.integral import integral_of
from frictionjax.simulation import simulate

OFFSET, NOISE = 2e-3, 1e-3  # rad/s
LIGHT = ("J", "sigma2", "Fc", "Fs")
"""What the sensor shows well: a velocity says little of the bristles."""


def measured(name, u, seed):
    """What a velocity sensor with an offset shows, integrated as a file of it is."""
    run = simulate(PLANT, u, RATE, substeps=SUBSTEPS)
    v = np.asarray(run.v) + OFFSET + NOISE * np.random.default_rng(seed).standard_normal(u.size)
    return Recording(name, RATE, u, integral_of(v, RATE), v=v, integrated=True)


@pytest.fixture(scope="module")
def recordings():
    t = np.arange(SAMPLES) / RATE
    waves = VOLT * (1.2 * np.sin(2.0 * np.pi * 0.9 * t) + 0.6 * np.sin(2.0 * np.pi * 2.3 * t))
    return measured("ramps", ramps_input(), 1), measured("waves", waves, 2)


@pytest.fixture(scope="module")
def fitted(recordings):
    start = other_start({"J": 1.2, "Fc": 0.85, "Fs": 0.9, "sigma2": 1.2}).with_effects(VelocityOffset())
    return fit(start, recordings, fixed=("sigma0", "sigma1", "vs"), own_starts=False, progress=False)


def test_the_truth_is_recovered_with_the_offset(fitted):
    for name in LIGHT:
        found = fitted.parameters[name]
        assert abs(found.value - TRUTH[name]) < 4.0 * found.stderr, (name, found)
        assert found.stderr < 1e-3 * TRUTH[name], name
    offset = fitted.parameters["offset"]
    assert abs(offset.value - OFFSET) < 4.0 * offset.stderr and offset.stderr < 0.05 * OFFSET


def test_its_noise_is_that_of_a_random_walk(fitted):
    for found in fitted.noise.values():
        # Interpolation takes a part of the noise near half of the sample rate, and no force is made of it.
        assert 0.7 < found.position / (NOISE / RATE / np.sqrt(2.0)) < 1.05
        assert found.push < 0.02 * TRUTH["Fc"]


def test_without_an_offset_in_the_model_the_fit_says_so(recordings, fitted):
    words = "the model has no offset of their sensor"
    assert words not in fitted.message
    bare = fit(PLANT, recordings, free=("J",), own_starts=False, progress=False)
    assert words in bare.message


def test_the_fit_travels(fitted):
    again = fit_from_json(fit_to_json(fitted))
    (effect,) = again.drive.effects
    assert isinstance(effect, VelocityOffset)
    assert float(effect.offset) == fitted.parameters["offset"].value
