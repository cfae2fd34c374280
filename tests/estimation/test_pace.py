"""The observer's pace: a coarse sensor is observed as slowly as an unmeasured force allows, as by a Kalman filter."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop
from scipy.linalg import solve_discrete_are

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH, pace_of, robust_posterior

FORCE = 0.005


def _batch(noise, rate=2000.0):
    u = np.sin(2 * np.pi * 2.0 * np.arange(4000) / 2000.0)
    recording = open_loop("moves", u, seed=1, noise=noise)
    return make_batch((dataclasses.replace(recording, sample_rate=rate),), encoder_step=FINE)


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


@pytest.mark.parametrize(("noise", "rate"), [(2e-5, 2000.0), (2e-5, 1000.0), (6e-6, 2000.0)])
def test_the_bandwidth_is_that_of_the_kalman_filter(noise, rate):
    batch = _batch(noise, rate)
    (pace,) = pace_of(PLANT, batch, FORCE)
    assert pace < 1.0
    assert pace * SLOW_BANDWIDTH == pytest.approx(_kalman(batch), rel=0.1)


def test_it_is_never_faster_than_usual_nor_slower_than_a_block_remembers():
    assert pace_of(PLANT, _batch(1e-9), FORCE)[0] == 1.0
    assert pace_of(PLANT, _batch(1.0), FORCE)[0] == pytest.approx(5.0 / SLOW_BANDWIDTH)


def test_a_posterior_keeps_its_pace_at_every_bandwidth():
    batch = _batch(2e-5)
    pace = pace_of(PLANT, batch, FORCE)
    paced, _ = robust_posterior(PLANT, batch, np.array([False]), pace=pace)
    usual, _ = robust_posterior(PLANT, batch, np.array([False]))
    for bandwidth in (100.0, 50.0):
        own = paced.at_bandwidth(bandwidth).recordings
        same = usual.at_bandwidth(bandwidth * float(pace[0])).recordings
        assert np.allclose(own.gains.position, same.gains.position, rtol=1e-12)
        assert np.allclose(own.with_substeps(2).at_bandwidth(bandwidth).gains.velocity, same.gains.velocity)


def test_a_wrong_friction_shows_at_its_pace_and_not_at_the_usual_one():
    """A tenth more of friction under a coarse sensor: how much more power it leaves than the true model."""
    batch = _batch(2e-5)
    friction = PLANT.friction
    wrong = dataclasses.replace(
        PLANT, friction=dataclasses.replace(friction, Fc=1.1 * friction.Fc, Fs=1.1 * friction.Fs)
    )
    powers = {}
    for name, pace in (("paced", pace_of(PLANT, batch, FORCE)), ("usual", None)):
        for drive in (PLANT, wrong):
            posterior, vector = robust_posterior(drive, batch, np.array([False]), pace=pace)
            errors = posterior.at_bandwidth(SLOW_BANDWIDTH).errors_at([vector])[0]
            powers[name, drive is wrong] = float(np.mean(errors[np.asarray(batch.valid) > 0] ** 2))
    assert powers["paced", False] < 1.3 and powers["usual", False] < 1.3
    more = {name: powers[name, True] - powers[name, False] for name in ("paced", "usual")}
    assert more["usual"] < 1.0
    assert more["paced"] > 10.0 * more["usual"]
