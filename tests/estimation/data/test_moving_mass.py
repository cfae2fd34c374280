"""A force cell with a mass behind it: friction is what is left of the measured force."""

import dataclasses

import numpy as np
import pytest
from helpers_plants import ROTARY

from frictionjax.core import InputError
from frictionjax.estimation import Observation
from frictionjax.estimation.data.moving_mass import (
    case_without_moving_mass,
    pieces_without_moving_mass,
    without_moving_mass,
)
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.recordings.recording import Given, GivenModel
from frictionjax.simulation import simulate_imposed

RATE, SAMPLES, INERTIA, NOISE = 1000.0, 3000, 0.05, 2e-3
T = np.arange(SAMPLES) / RATE
PARTS = ((0.03, 0.9), (6e-3, 3.3), (1e-4, 23.0))
"""Amplitude (rad) and frequency (Hz) of sines: the last one is a third of the force of the mass, and small beside x."""
X = sum(size * np.sin(2 * np.pi * f * T) for size, f in PARTS)
MASS = INERTIA * sum(-size * (2 * np.pi * f) ** 2 * np.sin(2 * np.pi * f * T) for size, f in PARTS)
PLANT = Plant(inertia=INERTIA, position_unit="rad", force_unit="N*m")


def _recorded(*, of_position=0.0, of_force=NOISE, plant=PLANT, **more):
    """A recording of friction and the force of a mass, and the friction alone with the noise of the cell."""
    rng = np.random.default_rng(1)
    friction = np.asarray(simulate_imposed(ROTARY, X, RATE).friction) + of_force * rng.standard_normal(
        SAMPLES
    )
    x = X + of_position * rng.standard_normal(SAMPLES)
    told = {"drive": "motion", "force": friction + MASS, "plant": plant} | more
    return Recording("r", RATE, np.zeros(SAMPLES), x, **told), friction


def test_an_exact_position_leaves_the_friction():
    recording, friction = _recorded()
    found = without_moving_mass(recording)
    assert np.std(np.asarray(found.force) - friction) < 0.05 * NOISE
    assert np.std(MASS) > 50 * NOISE
    (said,) = found.warnings
    assert "0.05 N*m*s^2/rad times the acceleration" in said and "finer" not in said


def test_noise_of_the_position_adds_no_more_than_the_cell_has():
    recording, friction = _recorded(of_position=1e-6)
    found = without_moving_mass(recording)
    assert np.std(np.asarray(found.force) - friction) < 1.1 * NOISE
    assert "finer" not in found.warnings[0]


def test_a_coarse_position_cuts_no_motion_off_and_is_said():
    """Over 77 ms the noise would be that of the cell, and the quickest sine be lost: 0.07 N m."""
    recording, friction = _recorded(of_position=1e-5)
    found = without_moving_mass(recording)
    assert np.std(np.asarray(found.force) - friction) < 5.0 * NOISE
    assert "times that of the force: record the position finer" in found.warnings[0]


def test_an_encoder_step_counts_as_noise():
    step = 4e-6
    recording, friction = _recorded(plant=dataclasses.replace(PLANT, encoder_step=step))
    recording = dataclasses.replace(recording, x=step * np.round(np.asarray(recording.x) / step))
    found = without_moving_mass(recording)
    assert np.std(np.asarray(found.force) - friction) < 1.5 * NOISE


def test_what_a_simulation_says_has_the_same_mass():
    recording, _ = _recorded()
    recording = dataclasses.replace(recording, simulated=np.asarray(recording.force) + 0.25)
    found = without_moving_mass(recording)
    np.testing.assert_allclose(np.asarray(found.simulated) - np.asarray(found.force), 0.25, atol=1e-12)


@pytest.mark.parametrize(
    "more",
    [{"plant": None}, {"plant": Plant()}, {"drive": "force", "force": None}],
    ids=["no plant", "none", "driven"],
)
def test_without_a_known_inertia_or_an_imposed_motion_nothing_changes(more):
    recording, _ = _recorded(**more)
    assert without_moving_mass(recording) is recording


def test_of_a_case_it_is_taken_off_once():
    recording, friction = _recorded()
    case = Case("c", PLANT, [recording])
    found = case_without_moving_mass(case)
    assert found.plant == dataclasses.replace(PLANT, inertia=None)
    assert found.model.parameters == {"J": Given(INERTIA, fixed=True)}
    assert np.std(np.asarray(found.recordings[0].force) - friction) < 0.05 * NOISE
    assert case_without_moving_mass(found) is found
    with pytest.raises(InputError, match=r"J is 0\.1 in the model, and the plant has the inertia 0\.05"):
        case_without_moving_mass(dataclasses.replace(case, model=GivenModel({"J": Given(0.1)})))


def test_of_the_pieces_of_a_fit_it_is_taken_off_and_said_once():
    recording, friction = _recorded()
    pieces, said = pieces_without_moving_mass((recording, Observation(recording, noise=NOISE)))
    assert len(said) == 1
    for one in (pieces[0], pieces[1].data):
        assert np.std(np.asarray(one.force) - friction) < 0.05 * NOISE
    assert pieces[1].noise == NOISE
