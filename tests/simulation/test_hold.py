"""An input that is linear between samples: its force within a sample, and the motion that it makes."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import ROTARY, effect
from helpers_traces import programs

from frictionjax.physics import Push, mean_of
from frictionjax.simulation import simulate

LINEAR = dataclasses.replace(ROTARY, hold="linear")
COARSE, PARTS = 100.0, 50
STEPS = 32


def _sweep(seed=0):
    """1 s of an input at 100 Hz that slides the plant to and fro, and the same as it runs from sample to sample, as the
    mean of each of 50 parts of a sample."""
    t = np.arange(100) / COARSE
    u = 0.06 * np.sin(2.0 * np.pi * 3.0 * t + seed) + 0.05 * np.sin(2.0 * np.pi * 7.3 * t)
    parts = (np.arange(100 * PARTS) + 0.5) / PARTS
    return u, np.interp(parts, np.arange(100), u)


def test_within_a_sample_the_force_rises_to_the_next_one():
    u = jnp.array([1.0, 3.0, 2.0])
    push = LINEAR.applied_force(u, jnp.array(0.01))
    assert isinstance(push, Push)
    np.testing.assert_allclose(push.mean, 16.0 * np.array([2.0, 2.5, 2.0]))
    np.testing.assert_allclose(push.rise, 16.0 * np.array([2.0, -1.0, 0.0]))
    assert not isinstance(ROTARY.applied_force(u, jnp.array(0.01)), Push)


def test_effects_on_the_input_act_on_its_mean():
    late = LINEAR.with_effects(effect("Delay", delay=0.01))
    assert late.hold == "linear"
    u = jnp.array([1.0, 3.0, 2.0, 2.0])
    np.testing.assert_allclose(
        mean_of(late.applied_force(u, jnp.array(0.01))), 16.0 * np.array([2.0, 2.0, 2.5, 2.0])
    )


def test_the_motion_is_that_of_the_input_sampled_finely():
    """Two roads: 100 Hz with a linear input, and 5 kHz with the held means of the same input."""
    u, fine = _sweep()
    reference = np.asarray(simulate(ROTARY, fine, COARSE * PARTS, substeps=1).x)[::PARTS]
    errors = {
        drive.hold: np.sqrt(
            np.mean((np.asarray(simulate(drive, u, COARSE, substeps=STEPS).x) - reference) ** 2)
        )
        for drive in (ROTARY, LINEAR)
    }
    assert np.ptp(reference) > 0.05  # it slides
    assert errors["linear"] < 2e-3 * np.ptp(reference)
    assert errors["zero"] > 20.0 * errors["linear"]


def test_new_numbers_need_no_new_program():
    simulate(LINEAR, _sweep()[0], COARSE, substeps=STEPS)
    other = dataclasses.replace(LINEAR, J=jnp.asarray(0.04))
    assert programs(lambda: simulate(other, _sweep(seed=2)[0], COARSE, substeps=STEPS)) == []


def test_a_drive_shows_what_is_not_usual():
    assert "hold='linear'" in repr(LINEAR) and "hold" not in repr(ROTARY)
    assert dataclasses.replace(LINEAR, effects=()).hold == "linear"
    with pytest.raises(TypeError):
        ROTARY.with_effects(hold="linear")
