"""Answers: a floor follows from the model that comes nearest to a perfect one."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT
from helpers_plants import effect
from helpers_selection import refitted, with_effect, world

from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.selection.answers import Answers
from frictionjax.diagnosis.selection.candidate_table import ground_of
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate


def _as_it_is(posterior, vector):
    fitted = descend(posterior, vector, graduate=False, steps=0)
    return Model(posterior, fitted, judge(posterior, fitted))


def _answer(model):
    return answer_to_force(model.posterior, model.fitted.vector)


@pytest.fixture
def executor():
    with ThreadPoolExecutor(1) as threads:
        yield threads


def test_the_likeliest_model_answers_and_is_asked_once(executor):
    base, scales = world("load")
    better = with_effect(base, "load", scales)
    answers = Answers(base, executor)
    found = answers.of_likeliest([base, better])
    np.testing.assert_array_equal(found.gain, _answer(better).gain)
    assert answers.of_likeliest([better, base]) is found
    np.testing.assert_array_equal(answers.of_likeliest([base]).gain, _answer(base).gain)
    assert np.any(_answer(base).gain != found.gain)


def test_a_model_with_a_gap_is_not_asked(executor):
    base, scales = world("load")
    gap = _as_it_is(*extend(base.posterior, base.fitted.vector, effect("Backlash").silenced(), scales))
    judgement = eqx.tree_at(lambda one: one.power, gap.judgement, 0.1 * gap.judgement.power)
    likely = dataclasses.replace(gap, judgement=judgement)
    answers = Answers(base, executor)
    own = answers.of_likeliest([base])
    assert answers.of_likeliest([base, likely]) is own and answers.of_likeliest([likely]) is own


def test_a_wrong_model_in_which_noise_grows_does_not_hold_a_right_one_to_too_low_a_floor(executor):
    """Friction that falls steeply with velocity makes slow sliding unstable: what noise leaves there, in the
    observer of that model alone, once passed for the noise of the recordings."""
    t, held_out, recordings = np.arange(600) / 100.0, np.array([False, True]), []
    for seed in (1, 2):
        u = 0.04 * np.sin(2.0 * np.pi * (0.3 + 0.1 * seed) * t)
        noise = 2e-5 * np.random.default_rng(seed).standard_normal(t.size)
        x = np.asarray(simulate(PLANT, u, 100.0, substeps=32).x) + noise
        recordings.append(Recording(f"slow {seed}", 100.0, u, x))
    batch = make_batch(tuple(recordings), encoder_step=FINE)
    steep = eqx.tree_at(
        lambda one: (one.Fs, one.vs), PLANT.friction, (2.5 * PLANT.friction.Fc, np.array(0.3))
    )
    right, wrong = (
        _as_it_is(posterior.at_bandwidth(SLOW_BANDWIDTH), vector)
        for posterior, vector in (
            robust_posterior(drive, batch, held_out, scales=plant_scales(PLANT, batch))
            for drive in (PLANT, eqx.tree_at(lambda one: one.friction, PLANT, steep))
        )
    )
    refits = [refitted(right, "load")]
    far, near = (
        right.judgement.misfits(ground_of(wrong, refits, answer).floor)
        for answer in (_answer(wrong), Answers(wrong, executor).of_likeliest([wrong, right]))
    )
    assert np.max(_answer(wrong).growth) > 1000.0
    assert max(far) > 0.5 and max(near) < 0.01
