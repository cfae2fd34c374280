"""Measured friction forces: the noise that a drive leaves in them."""

import numpy as np
import pytest
from helpers_plants import ROTARY
from helpers_traces import programs

from frictionjax.estimation.evidence.forces import make_forces
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate_imposed

RATE = 1000.0
NOISE = (2e-3, 5e-3)  # N m


def _forces(seed, known=None):
    rng, t = np.random.default_rng(seed), np.arange(1500) / RATE
    x = 0.03 * np.sin(2.0 * np.pi * 0.9 * t) + 6e-3 * np.sin(2.0 * np.pi * 3.3 * t)
    friction = np.asarray(simulate_imposed(ROTARY, x, RATE).friction)
    return make_forces(
        tuple(
            Recording(
                f"run {noise}",
                RATE,
                np.zeros(x.size),
                x,
                drive="motion",
                force=friction + noise * rng.standard_normal(x.size),
            )
            for noise in NOISE
        ),
        known,
    )


def test_the_noise_of_each_recording_is_what_the_drive_leaves():
    found = _forces(0).with_noise_of(ROTARY, np.zeros(2))
    np.testing.assert_allclose(np.asarray(found.noise), NOISE, rtol=4.0 / np.sqrt(2.0 * 1500))


def test_a_noise_that_is_known_stays():
    found = np.asarray(_forces(0, (None, 0.1)).with_noise_of(ROTARY, np.zeros(2)).noise)
    assert found[1] == 0.1 and found[0] == pytest.approx(NOISE[0], rel=0.1)


def test_another_drive_compiles_nothing():
    """A fit asks in each of its rounds."""
    forces = _forces(1)
    forces.with_noise_of(ROTARY, np.zeros(2))
    other = Drive(2.0 * ROTARY.J, ROTARY.friction, ROTARY.motor_constant)
    assert programs(lambda: forces.with_noise_of(other, np.full(2, 0.1)).noise) == []
