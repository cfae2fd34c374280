"""A second inertia shows in the data before any model."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, closed_loop, moves, open_loop
from helpers_plants import effect

from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.resonance import is_coherent, resonance_pair
from frictionjax.diagnosis.screening.score_test import forms_to_try, try_form
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive, LuGre

LIGHT = LuGre(sigma0=60.0, sigma1=0.3, sigma2=0.05, Fc=0.02, Fs=0.025, vs=1.0)
"""Friction that a hundred times its force moves past."""


def _recorded(drive):
    u = np.random.default_rng(5).standard_normal(16_000)
    return make_batch((open_loop("noise", 3.0 * u, seed=1, drive=drive, noise=1e-7, substeps=2),))


def test_the_pair_of_two_inertias_is_found():
    coupled = Drive(0.01, LIGHT).with_effects(
        effect("FlexibleTransmission", ratio=0.5, frequency=50.0, damping=0.02)
    )
    pair = resonance_pair(_recorded(coupled), np.arange(1))
    assert RATE == 2000.0
    assert pair is not None
    assert pair.frequency == pytest.approx(50.0, abs=1.25)
    assert pair.ratio == pytest.approx(0.5, abs=0.05)


def test_an_input_is_coherent_with_the_motion_that_it_makes_alone():
    recorded = _recorded(Drive(0.01, LIGHT))
    other = np.random.default_rng(6).standard_normal(recorded.u.shape)
    assert is_coherent(recorded)
    assert not is_coherent(dataclasses.replace(recorded, u=other))


def test_a_slow_sine_shows_no_pair():
    t = np.arange(16_000) / RATE
    slow = np.sin(2.0 * np.pi * 0.5 * t)
    batch = make_batch((open_loop("slow", slow, seed=1, drive=Drive(0.01, LIGHT), noise=1e-7),))
    assert resonance_pair(batch, np.arange(1)) is None


@pytest.mark.parametrize("place", [1, 4, 9])
def test_a_load_that_rings_between_two_frequencies_of_the_grid_is_found(place):
    """Half-way from one to the next, where its damping is light."""
    form = type(effect("FlexibleTransmission"))
    plain = forms_to_try(form, {"turn": 2.0 * np.pi}, {})
    tried = sorted({float(one.frequency) for one in plain})
    frequency = float(np.sqrt(tried[place] * tried[place + 1]))
    rings = effect("FlexibleTransmission", ratio=0.15, frequency=frequency, damping=0.015)
    drive = PLANT.with_effects(rings)
    files = [closed_loop(f"moves {seed}", moves(4.0), seed=seed, drive=drive) for seed in (1, 2)]
    batch = make_batch(tuple(files), encoder_step=FINE)
    posterior, start = robust_posterior(PLANT, batch, np.zeros(2, bool))
    present = present_model(posterior, descend(posterior, start, graduate=False).vector)
    trials = try_form(present, plain, plant_scales(PLANT, batch))
    best = max(trials, key=lambda trial: trial.gain)
    assert best.p_value < 0.01 and best.gain > 0.3 * present.misfit
    assert float(best.form.frequency) in (tried[place], tried[place + 1])
