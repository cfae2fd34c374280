"""The observer's pace: a coarse sensor is observed as slowly as an unmeasured force and unstable friction allow."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, closed_loop, open_loop
from helpers_plants import effect
from scipy.linalg import solve_discrete_are

from frictionjax.diagnosis.evidence import pace as pace_module
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force, floor_of
from frictionjax.diagnosis.evidence.pace import free_mass_bandwidth, pace_of, search_bandwidth
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, robust_posterior

FORCE = Rule().floor.largest_force
FITTED = np.array([False])
COARSE = 2e-5
"""Noise, rad, under which a free mass asks for 11 Hz."""


def _batch(noise=COARSE, rate=2000.0):
    u = np.sin(2 * np.pi * 2.0 * np.arange(4000) / 2000.0)
    recording = open_loop("moves", u, seed=1, noise=noise)
    return make_batch((dataclasses.replace(recording, sample_rate=rate),), encoder_step=FINE)


def _with_friction(**values):
    return dataclasses.replace(PLANT, friction=dataclasses.replace(PLANT.friction, **values))


def _kalman(batch):
    """Natural frequency of the error of the Kalman filter of a free mass, over 2 pi, Hz."""
    dt, noise = float(batch.dt[0]), float(batch.noise[0])
    step, into = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[0.5 * dt**2], [dt]])
    push = FORCE * float(PLANT.friction.Fc) / float(PLANT.J)
    seen = np.array([[1.0, 0.0]])
    left = solve_discrete_are(step.T, seen.T, push**2 * into @ into.T, np.array([[noise**2]]))
    gain = left @ seen.T / (seen @ left @ seen.T + noise**2)
    poles = np.linalg.eigvals(step @ (np.eye(2) - gain @ seen))
    return float(np.sqrt(np.prod(np.abs(np.log(poles.astype(complex)) / dt)))) / (2.0 * np.pi)


@pytest.mark.parametrize(("noise", "rate"), [(COARSE, 2000.0), (COARSE, 1000.0), (6e-6, 2000.0)])
def test_the_bandwidth_of_a_free_mass_is_that_of_its_kalman_filter(noise, rate):
    batch = _batch(noise, rate)
    assert free_mass_bandwidth(PLANT, batch, Rule())[0] == pytest.approx(_kalman(batch), rel=0.1)


def test_a_machine_that_slides_is_observed_like_a_free_mass():
    batch = _batch()
    (pace,) = pace_of(PLANT, batch, FITTED)
    optimum = free_mass_bandwidth(PLANT, batch, Rule())[0]
    assert optimum <= pace * SLOW_BANDWIDTH < 2.0 * optimum


@pytest.mark.parametrize(("noise", "bandwidth"), [(1e-8, FAST_BANDWIDTH), (COARSE, SLOW_BANDWIDTH)])
def test_effects_are_searched_through_the_slow_observer_of_a_coarse_sensor(noise, bandwidth):
    batch = _batch(noise)
    off = _with_friction(Fc=0.5 * PLANT.friction.Fc, Fs=0.5 * PLANT.friction.Fs)
    posterior, vector = robust_posterior(off, batch, FITTED, pace=pace_of(PLANT, batch, FITTED))
    assert search_bandwidth(posterior, vector) == bandwidth


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("fast", "slow", "bandwidth"), [(1.2, 0.8, FAST_BANDWIDTH), (0.8, 1.2, SLOW_BANDWIDTH)]
)
def test_of_a_coarse_sensor_the_observer_that_shows_more_of_what_is_missing_searches(
    fast, slow, bandwidth, monkeypatch
):
    class Shown:
        """An objective whose misfit is known."""

        def at_bandwidth(self, asked):
            self.asked = asked
            return self

        def misfits(self, vectors):
            return np.full(len(vectors), fast if self.asked == FAST_BANDWIDTH else slow)

    monkeypatch.setattr(pace_module, "is_coarse", lambda posterior: True)
    assert search_bandwidth(Shown(), np.zeros(3)) == bandwidth


def test_an_effect_of_the_base_model_changes_no_free_mass():
    batch = _batch()
    loaded = PLANT.with_effects(effect("ConstantLoad", load=0.01))
    assert pace_of(loaded, batch, FITTED) == pytest.approx(pace_of(PLANT, batch, FITTED))


def test_the_pace_is_never_faster_than_usual_nor_slower_than_a_block_remembers():
    assert pace_of(PLANT, _batch(1e-9), FITTED)[0] == 1.0
    assert pace_of(PLANT, _batch(2e-6), FITTED)[0] == 1.0
    assert pace_of(PLANT, _batch(1e-3), FITTED)[0] == 0.125


def _unstable():
    """A plant whose friction falls steeply with velocity, in a slow motion; and its recording."""
    drive = _with_friction(Fs=1.5 * PLANT.friction.Fc, vs=0.05)
    t = np.arange(4000) / 2000.0
    recording = closed_loop("slow", 0.05 * np.sin(2.0 * np.pi * 0.5 * t), seed=2, drive=drive, noise=COARSE)
    return drive, make_batch((recording,), encoder_step=FINE)


def test_where_no_pace_gives_finite_numbers_it_is_the_usual_one(monkeypatch):
    monkeypatch.setattr(pace_module, "_answer", lambda *_: np.array([np.inf]))
    assert pace_of(PLANT, _batch(), FITTED) == 1.0


def test_unstable_sliding_is_observed_faster_and_its_growth_is_in_the_floor():
    """Noise that the motion amplifies is no error of the model: the true model is at the floor at either pace."""
    drive, batch = _unstable()
    slow = free_mass_bandwidth(drive, batch, Rule()) / SLOW_BANDWIDTH
    own = pace_of(drive, batch, FITTED)
    assert own[0] > 1.5 * slow[0]
    for pace in (slow, own):
        posterior, vector = robust_posterior(drive, batch, FITTED, pace=pace)
        posterior = posterior.at_bandwidth(SLOW_BANDWIDTH)
        answer = answer_to_force(posterior, vector)
        power = batch.block_mean(posterior.errors_at([vector])[0] ** 2)[np.asarray(batch.block_count) > 0]
        floor = floor_of(0.0, answer)[np.asarray(batch.block_count) > 0]
        assert np.median(power / floor) < 2.0
    assert np.min(answer.growth) >= 1.0


def test_a_stable_motion_has_no_growth():
    batch = _batch()
    posterior, vector = robust_posterior(PLANT, batch, FITTED, pace=pace_of(PLANT, batch, FITTED))
    growth = answer_to_force(posterior.at_bandwidth(SLOW_BANDWIDTH), vector).growth
    assert np.mean(growth > 1.0) < 0.2


def test_a_posterior_keeps_its_pace_at_every_bandwidth():
    batch, pace = _batch(), np.array([0.3])
    paced, _ = robust_posterior(PLANT, batch, FITTED, pace=pace)
    usual, _ = robust_posterior(PLANT, batch, FITTED)
    for bandwidth in (100.0, 50.0):
        own = paced.at_bandwidth(bandwidth)
        same = usual.at_bandwidth(bandwidth, pace=pace)
        assert own.recordings.bandwidth == pytest.approx(0.3 * bandwidth)
        for other in (same, same.with_substeps(2).at_bandwidth(bandwidth)):
            assert np.allclose(own.recordings.gains.velocity, other.recordings.gains.velocity, rtol=1e-12)


def test_a_wrong_friction_shows_at_its_pace_and_not_at_the_usual_one():
    """A tenth more of friction under a coarse sensor: how much more power it leaves than the true model."""
    batch = _batch()
    wrong = _with_friction(Fc=1.1 * PLANT.friction.Fc, Fs=1.1 * PLANT.friction.Fs)
    more = {}
    for name, pace in (("paced", pace_of(PLANT, batch, FITTED)), ("usual", None)):
        powers = []
        for drive in (PLANT, wrong):
            posterior, vector = robust_posterior(drive, batch, FITTED, pace=pace)
            errors = posterior.at_bandwidth(SLOW_BANDWIDTH).errors_at([vector])[0]
            powers.append(float(np.mean(errors[np.asarray(batch.valid) > 0] ** 2)))
        assert powers[0] < 1.3
        more[name] = powers[1] - powers[0]
    assert more["usual"] < 1.0
    assert more["paced"] > 10.0 * more["usual"]
