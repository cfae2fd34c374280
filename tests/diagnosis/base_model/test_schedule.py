"""Gains by schedule: under a coarse sensor slow observers are Kalman filters, which show what constant gains hide."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, closed_loop, open_loop

from frictionjax.diagnosis.base_model import likeliest
from frictionjax.diagnosis.base_model.credibility import reference_power
from frictionjax.diagnosis.base_model.likeliest import at_the_pace_of, observed_as_asked
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model, scene_of
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force, floor_of, quietness
from frictionjax.diagnosis.evidence.pace import at_pace, free_mass_bandwidth, pace_of, schedule_of
from frictionjax.diagnosis.evidence.views import view
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, robust_posterior
from frictionjax.physics.effects.ripple import Ripple

FITTED = np.array([False])
COARSE = 2e-5


def _with_friction(**values):
    return dataclasses.replace(PLANT, friction=dataclasses.replace(PLANT.friction, **values))


STEEP = _with_friction(Fs=1.4 * PLANT.friction.Fc, vs=0.05)
"""Friction that falls steeply with velocity: in slow sliding the motion is unstable."""


@pytest.fixture(scope="module")
def batch():
    t = np.arange(8000) / 2000.0
    slow = closed_loop("slow", 0.05 * np.sin(np.pi * t), seed=2, drive=STEEP, noise=COARSE, substeps=4)
    return make_batch((slow,), encoder_step=FINE).with_substeps(4)


def _observed(drive, batch, by_schedule=True):
    """The posterior of `drive` with slow observers, and its vector; the schedule is that of the true machine."""
    pace = pace_of(STEEP, batch, FITTED)
    true, there = robust_posterior(STEEP, batch, FITTED, pace=pace)
    posterior, vector = robust_posterior(drive, batch, FITTED, pace=pace)
    return at_pace(posterior, pace, schedule_of(true, there, pace) if by_schedule else None), vector


def _misfit(drive, batch, by_schedule):
    """What `drive` leaves above the floor of the true machine, nats a sample."""
    true, there = _observed(STEEP, batch, by_schedule)
    answer = answer_to_force(true, there)
    quiet = quietness(true.powers([there])[0], answer, true)
    posterior, vector = _observed(drive, batch, by_schedule)
    losses = losses_of(posterior.powers([vector])[0], batch, floor_of(0.0, answer, quiet))
    return float(np.sum(losses) / np.sum(batch.block_count))


def test_a_true_model_is_at_the_noise_in_an_unstable_motion(batch):
    posterior, vector = _observed(STEEP, batch)
    used = np.asarray(batch.block_count) > 0
    power = posterior.powers([vector])[0][used]
    # Of some 3 independent samples in each of 75 blocks and more, and a noise level that is estimated, too.
    assert np.mean(power) == pytest.approx(1.0, abs=0.15)
    assert abs(_misfit(STEEP, batch, True)) < Rule().limits.adequate


def test_the_floor_is_what_noise_and_the_largest_force_leave(batch):
    """By two roads: the variances of the filter, and the answers of the machine to both."""
    posterior, vector = _observed(STEEP, batch)
    used = np.asarray(batch.block_count) > 0
    floor = floor_of(Rule().floor.largest_force, answer_to_force(posterior, vector))[used]
    assert np.median(floor) == pytest.approx(1.0, abs=0.1)


def test_it_shows_a_fall_of_friction_that_constant_gains_hide(batch):
    """Static friction a tenth lower, in slow sliding: constant gains that noise does not explode in follow it."""
    wrong = _with_friction(Fs=1.26 * PLANT.friction.Fc, vs=0.05)
    shown, hidden = (_misfit(wrong, batch, by_schedule) for by_schedule in (True, False))
    assert shown > 10.0 * Rule().limits.adequate
    assert shown > 3.0 * hidden


def test_a_true_model_stays_with_a_machine_that_is_held_near_break_away():
    """There a filter's gains jump with the noise: an observer with these is led away, to a mean power of 100."""
    t, friction = np.arange(8000) / 2000.0, STEEP.friction
    held = float(0.95 * friction.Fs / STEEP.motor_constant)
    hold = open_loop(
        "hold", np.interp(t, [0.3, 1.0], [0.0, held]), seed=2, drive=STEEP, noise=COARSE, substeps=4
    )
    batch = make_batch((hold,), encoder_step=FINE).with_substeps(4)
    posterior, vector = _observed(STEEP, batch)
    assert posterior.recordings.schedule.used.all()
    power = posterior.powers([vector])[0][np.asarray(batch.block_count) > 0]
    assert np.mean(power) < 2.0 and np.max(power) < 8.0


def test_the_gains_follow_the_machine(batch):
    """More where friction falls and noise grows, less where the bristles hold the machine."""
    posterior, _ = _observed(STEEP, batch)
    gains, x = np.asarray(posterior.recordings.gains.position)[0], np.asarray(batch.x)[0]
    speed = np.abs(np.gradient(np.convolve(x, np.ones(101) / 101, mode="same"), 1.0 / 2000.0))
    inside = slice(1000, batch.lengths[0] - 200)
    rests, falls = speed[inside] < 1e-3, (speed[inside] > 0.02) & (speed[inside] < 0.08)
    assert rests.sum() > 100 and falls.sum() > 100
    assert np.median(gains[inside][falls]) > 2.0 * np.median(gains[inside][rests])


def _with_gains_of(machine, batch, pace, model=STEEP):
    """The `model`, or the true machine, as a fitted one whose observers have the gains that this `machine` asks for."""
    other, there = robust_posterior(machine, batch, FITTED, pace=pace)
    posterior, vector = robust_posterior(model, batch, FITTED, pace=pace)
    own = at_pace(posterior, pace, schedule_of(other, there, pace))
    fitted = descend(own, vector, graduate=False, steps=0)
    return Model(own, fitted, judge(own, fitted))


def test_predictions_and_their_map_have_the_gains_that_judge(batch):
    """By two roads: what a view predicts one sample ahead, and what the model was judged by."""
    found = _with_gains_of(STEEP, batch, pace_of(STEEP, batch, FITTED))
    scene = scene_of(found, ("slow",))
    assert scene.varying is not None and scene.white.all() and scene.of(np.array([0])).white.all()
    seen = view(found.judgement, scene)
    (judged,) = found.posterior.errors_at([found.fitted.vector])
    np.testing.assert_allclose(seen.e, judged, rtol=1e-9, atol=1e-9)
    x, used = np.asarray(batch.x), np.asarray(batch.valid) > 0
    unit = np.asarray(batch.noise)[:, None] * scene.varying.unit
    np.testing.assert_allclose(((x - seen.one_sample) / unit)[used], judged[used], rtol=1e-9, atol=1e-9)
    constant = dataclasses.replace(scene, varying=None)
    assert np.std(view(found.judgement, constant).e[used]) != pytest.approx(np.std(judged[used]), rel=0.01)


def test_gains_of_a_wrong_machine_make_way_for_those_of_the_model(batch):
    """A filter for a machine whose friction does not fall corrects too little, and condemns the truth."""
    unit, flat = np.ones((1, 1)), _with_friction(Fs=1.01 * PLANT.friction.Fc, vs=0.05)
    found = _with_gains_of(STEEP, batch, pace_of(STEEP, batch, FITTED))
    assert at_the_pace_of(found, found, remains=True) is None
    # At the pace of the wrong machine, and at its own, so that the gains alone are wrong.
    for pace in (pace_of(flat, batch, FITTED), pace_of(STEEP, batch, FITTED)):
        condemned = _with_gains_of(flat, batch, pace)
        assert at_the_pace_of(condemned, condemned, remains=False) is None
        again = at_the_pace_of(condemned, condemned, remains=True)
        assert again is not None
        left = condemned.judgement.misfits(unit)[0]
        assert left > Rule().limits.adequate
        assert again.judgement.misfits(unit)[0] < 0.1 * left


def test_gains_that_hide_what_a_model_misses_make_way_as_well():
    """A filter for a third of the inertia corrects more, and follows a machine with a ripple that the model lacks."""
    unit, t = np.ones((1, 1)), np.arange(8000) / 2000.0
    rippled = STEEP.with_effects(Ripple(sine=0.03 * PLANT.friction.Fc, period=0.1))
    slow = closed_loop("slow", 0.05 * np.sin(np.pi * t), seed=2, drive=rippled, noise=COARSE, substeps=4)
    batch = make_batch((slow,), encoder_step=FINE).with_substeps(4)
    light = dataclasses.replace(STEEP, J=STEEP.J / 3.0)
    hidden = _with_gains_of(light, batch, pace_of(light, batch, FITTED))
    assert hidden.judgement.misfits(unit)[0] < 2.0 * Rule().limits.adequate
    for remains in (False, True):
        again = at_the_pace_of(hidden, hidden, remains=remains)
        assert again is not None
        # Converged: what is left is no matter of parameters.
        assert again.judgement.misfits(unit)[0] > 5.0 * Rule().limits.adequate


def _asked(drive, batch, monkeypatch, ends_at=None):
    """The recordings as `drive` asks for them, where least squares ends at the drive `ends_at`, or at itself."""
    posterior, vector = robust_posterior(drive, batch, FITTED, pace=pace_of(drive, batch, FITTED))
    there = vector if ends_at is None else robust_posterior(ends_at, batch, FITTED)[1]
    monkeypatch.setattr(likeliest, "likeliest", lambda posterior, vector: there)
    asked, end = observed_as_asked(posterior, vector, FITTED)
    assert np.array_equal(end, there)
    return asked.recordings, schedule_of(posterior, vector, np.asarray(asked.recordings.pace))


def test_parameters_of_no_machine_ask_for_nothing(batch, monkeypatch):
    """Least squares may end at next to no friction, which falls nowhere; the robust fit knew better."""
    nonsense = _with_friction(Fc=0.3 * PLANT.friction.Fc, Fs=0.9 * PLANT.friction.Fs, vs=5.0)
    recordings, own = _asked(STEEP, batch, monkeypatch, nonsense)
    assert recordings.varies.all()
    np.testing.assert_array_equal(recordings.gains.position, own.gains.position)


def test_a_filter_that_lost_the_machine_makes_way_for_constant_gains(batch, monkeypatch):
    """A model that sticks where the machine moves corrects less and less, as if it knew where the machine is."""
    stuck = _with_friction(Fc=3.0 * PLANT.friction.Fc, Fs=3.5 * PLANT.friction.Fs)
    recordings, own = _asked(stuck, batch, monkeypatch)
    assert own.used.all() and not recordings.varies.any()
    assert np.ptp(recordings.gains.position) == 0.0
    recordings, _ = _asked(STEEP, batch, monkeypatch)
    assert recordings.varies.all()


def test_no_model_is_observed_with_the_same_gains(batch):
    """By two roads: with gains that do not vary it is what constant gains leave."""
    posterior, _ = _observed(STEEP, batch, by_schedule=False)
    recordings = posterior.recordings
    constant = recordings.without_model()
    np.testing.assert_allclose(recordings.without_model_as_observed(), constant, atol=1e-4)  # rounding
    scheduled = _observed(STEEP, batch)[0]
    assert np.all(reference_power(posterior) == np.asarray(batch.block_mean(constant**2)))
    steady = np.asarray(batch.block_mean(scheduled.recordings.without_model() ** 2))
    assert np.all(reference_power(scheduled) <= steady) and np.any(reference_power(scheduled) < steady)


def test_fast_observers_have_constant_gains_and_pieces_keep_what_they_need(batch):
    posterior, _ = _observed(STEEP, batch)
    fast = posterior.at_bandwidth(FAST_BANDWIDTH)
    assert np.ptp(np.asarray(fast.recordings.gains.position)) == 0.0
    assert not fast.recordings.varies.any() and posterior.recordings.varies.all()
    again = fast.at_bandwidth(SLOW_BANDWIDTH)
    assert np.array_equal(again.recordings.gains.position, posterior.recordings.gains.position)
    assert posterior.recordings.bandwidth == pytest.approx(free_mass_bandwidth(STEEP, batch, Rule()))
    part = again.first(2000)
    most = part.batch.x.shape[1]
    assert part.recordings.gains.velocity.shape == part.recordings.schedule.unit.shape == (1, most)
    errors, whole = (one.errors_at([posterior.start])[0] for one in (part, posterior))
    assert np.allclose(errors, whole[:, :most], rtol=1e-12, atol=1e-12)


def test_a_fine_sensor_has_no_schedule():
    u = np.sin(2 * np.pi * 2.0 * np.arange(4000) / 2000.0)
    fine = make_batch((open_loop("moves", u, seed=1, noise=1e-8),), encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, fine, FITTED)
    assert schedule_of(posterior, vector, pace_of(PLANT, fine, FITTED)) is None
    own = at_pace(posterior, np.ones(1), None)
    assert np.array_equal(
        own.recordings.gains.position, posterior.at_bandwidth(50.0).recordings.gains.position
    )
