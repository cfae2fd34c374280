"""The floor: the unmeasured force and the measurement noise that a true model leaves, stated from what is planted."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, NOISE, PLANT, RATE, break_away, open_loop, stick_noise
from scipy.signal import lfilter

from frictionjax.diagnosis.base_model.fit_base import parameters_of
from frictionjax.diagnosis.evidence.judgement import Judgement, judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import (
    answer_to_force,
    colour,
    floor_of,
    force_noise,
    predictable,
    quietness,
    scatter,
)
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch, noise_level
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, robust_posterior
from frictionjax.recordings import Recording
from frictionjax.simulation import innovation_gain, observer_gains

RULE = Rule()
QUIET = 0.03
"""Noise of these recordings over that of the others: a force of that size shows in a few seconds."""
FORCE = 0.002
"""Standard deviation of the planted force, over Coulomb friction."""


def _shaken(name, u, *, seed, force=FORCE):
    """A recording during which a force acts that is not in its input."""
    push = (
        force
        * float(PLANT.friction.Fc / PLANT.motor_constant)
        * np.random.default_rng(100 + seed).standard_normal(len(u))
    )
    recording = open_loop(name, jnp.asarray(u) + jnp.asarray(push), seed=seed, noise=QUIET * NOISE)
    return eqx.tree_at(lambda r: r.u, recording, np.asarray(u))


def _to_and_fro():
    t = np.arange(round(4.0 * RATE)) / RATE
    return 1.6 * float(PLANT.friction.Fs / PLANT.motor_constant) * np.sin(2.0 * np.pi * 1.5 * t)


def _true_model(force):
    recordings = (
        _shaken("stick", stick_noise(4.0, seed=0), seed=1, force=force),
        _shaken("ramps", break_away(), seed=2, force=force),
        _shaken("sliding", _to_and_fro(), seed=3, force=force),
    )
    posterior, vector = robust_posterior(
        PLANT, make_batch(recordings, encoder_step=QUIET * FINE), np.zeros(3, bool)
    )
    slow = posterior.at_bandwidth(SLOW_BANDWIDTH)
    return slow, vector, slow.powers([vector])[0]


@pytest.fixture(scope="module")
def shaken():
    return _true_model(FORCE)


def test_the_planted_force_is_found(shaken):
    """A quantile of blocks that hold few free numbers is below their mean; the simulated blocks tell by how much."""
    posterior, vector, power = shaken
    answer = answer_to_force(posterior, vector)
    quiet = quietness(power, answer, posterior)
    found = force_noise(power, answer, posterior, quiet)
    seen = answer.gain > 0.1 * answer.gain.max()
    asked = np.sqrt(np.quantile(((power - quiet) / np.where(seen, answer.gain, 1.0))[seen], 0.4))
    assert asked < 0.95 * found
    # A hundred blocks or more of some ten free numbers each: their mean is known to 5 %, the force to half of that.
    assert found == pytest.approx(FORCE, rel=0.075)


def test_a_true_model_is_at_the_floor(shaken):
    posterior, vector, power = shaken
    answer = answer_to_force(posterior, vector)
    quiet = quietness(power, answer, posterior)
    seen = Judgement(PLANT, vector, power, np.zeros(3, bool), posterior.batch)
    bare, floored = (
        seen.misfits(floor)[0]
        for floor in (np.ones((1, 1)), floor_of(force_noise(power, answer, posterior, quiet), answer, quiet))
    )
    assert bare > 0.2
    # The logarithm of blocks that scatter is below that of their mean.
    assert -0.06 < floored < 0.01


def test_without_a_force_none_is_found():
    posterior, vector, power = _true_model(0.0)
    answer = answer_to_force(posterior, vector)
    assert force_noise(power, answer, posterior, quietness(power, answer, posterior)) < 0.1 * FORCE


def test_noise_that_was_thought_twice_as_large_is_mended(shaken):
    """Motion near the frequency of sampling passes for noise; a model that leaves less shows that there is less."""
    posterior = eqx.tree_at(
        lambda j: j.evidence[0].batch.noise, shaken[0], jnp.asarray(shaken[0].batch.noise).at[0].multiply(2.0)
    )
    answer = answer_to_force(*shaken[:2])
    clean = quietness(shaken[2], answer, shaken[0])
    quiet = quietness(posterior.powers([shaken[1]])[0], answer, posterior)
    assert quiet.shape == (3, 1)
    assert quiet[0, 0] == pytest.approx(0.25 * clean[0, 0], rel=0.1)
    np.testing.assert_array_equal(quiet[1:], clean[1:])
    assert np.all(clean <= 1.0)
    assert float(np.max(posterior.batch.noise[1:])) < 2.0 * QUIET * NOISE


def test_colour_raises_the_floor_of_its_own_recording_alone(shaken):
    """By what the middle block asks for, between nothing and twice."""
    posterior, _, power = shaken
    floor = np.ones_like(power)
    scored = np.asarray(posterior.batch.block_count) > 0
    for factor, found in ((0.5, 1.0), (1.5, 1.5), (7.0, RULE.floor.colour)):
        powers = np.where(scored, 1.0, 0.0)
        powers[1] *= factor
        np.testing.assert_allclose(colour(powers, floor, posterior)[:, 0], [1.0, found, 1.0])


def test_coloured_noise_has_at_most_the_power_that_its_bound_says():
    """At 2 kHz, nine tenths of the power below 200 Hz: `noise_level` sees the tenth that is white, an observer of
    50 Hz, which forgets slow changes, twice that."""
    rng, count, share = np.random.default_rng(0), 100_000, 0.9
    pole = np.exp(-2.0 * np.pi * 200.0 / RATE)
    slow = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(count))
    x = NOISE * (np.sqrt(1.0 - share) * rng.standard_normal(count) + np.sqrt(share) * slow)
    level = noise_level(Recording("coloured", RATE, np.zeros(count), x), FINE)
    gains = observer_gains(50.0, 1.0 / RATE)
    p = float(np.sqrt(1.0 - gains.position))
    innovation = lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * p, p**2], x) / float(innovation_gain(gains))
    assert level < 0.75 * np.std(x)
    assert np.var(innovation) / level**2 == pytest.approx(RULE.floor.colour, rel=0.05)


def test_runs_of_a_machine_that_is_not_chaotic_part_by_the_force_alone(shaken):
    """The linear answer to a force a twentieth of the size, from other draws."""
    posterior, vector, _ = shaken
    answer, parted = answer_to_force(posterior, vector), scatter(posterior, vector, FORCE)
    seen = answer.gain > 0.1 * answer.gain.max()
    assert np.median(parted[seen] / (FORCE**2 * answer.gain[seen])) == pytest.approx(1.0, rel=0.15)
    np.testing.assert_array_equal(scatter(posterior, vector, 0.0), 0.0)


def test_what_a_force_makes_unpredictable_is_left_out_of_a_fit(shaken):
    posterior, vector, _ = shaken
    parted = scatter(posterior, vector, FORCE)
    calm, some = predictable(posterior, vector, FORCE)
    kept = np.asarray(calm.weights[0]).reshape(calm.batch.block_count.shape) > 0.0
    scored = np.asarray(posterior.batch.block_count) > 0
    assert some and 0.05 < np.mean(kept[scored]) < 0.95
    np.testing.assert_array_equal(kept, parted < 1.0)
    np.testing.assert_array_equal(calm.powers([vector])[0], posterior.powers([vector])[0])
    assert float(calm.near(vector).cost) < float(posterior.near(vector).cost)
    whole, none = predictable(posterior, vector, 0.0)
    assert not none
    np.testing.assert_array_equal(whole.weights[0], posterior.weights[0])


@pytest.mark.parametrize("lost", [np.nan, np.inf, -1e200])
def test_where_a_run_is_lost_nothing_is_predictable(shaken, monkeypatch, lost):
    posterior, vector, _ = shaken
    change = np.zeros(np.asarray(posterior.batch.x).shape)
    change[0, change.shape[1] // 2 :] = lost
    monkeypatch.setattr(
        "frictionjax.diagnosis.evidence.noise_floor._force_response", lambda *arguments: change
    )
    calm, some = predictable(posterior, vector, FORCE)
    kept = np.asarray(calm.weights[0]).reshape(calm.batch.block_count.shape) > 0.0
    half = kept.shape[1] // 2
    assert some and not np.any(kept[0, half + 1 :])
    assert np.all(kept[0, : half - 10]) and np.all(kept[1:])


def test_a_model_whose_curvature_is_no_number_is_reported_as_unknown(shaken):
    posterior, vector, _ = shaken
    fitted = descend(posterior, vector, graduate=False, steps=1)
    lost = fitted._replace(
        near=eqx.tree_at(lambda near: near.hessian, fitted.near, jnp.nan * fitted.near.hessian)
    )
    found = parameters_of(Model(posterior, lost, judge(posterior, lost)), {}, lacking=True)
    assert all(e.stderr == float("inf") for e in found.values())
