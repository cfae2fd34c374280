"""The Kalman filter: under the true model its innovations are white, of the variance that it reports."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import STAGE

from frictionjax.physics.effects.encoder_error import EncoderError
from frictionjax.physics.effects.sensor_lag import SensorLag
from frictionjax.simulation import sensor_noise, simulate
from frictionjax.simulation.kalman import driven_by, kalman_filter, predicted_with

RATE, N = 2000.0, 6000
DT = jnp.asarray(1.0 / RATE)
SENSORS = {
    "plain": (),
    "velocity": (),
    "late": (SensorLag(3e-3),),
    "uneven": (EncoderError(sine=2e-6, cosine=1e-6, period=5e-4),),
}


@pytest.fixture(scope="module", params=SENSORS)
def filtered(request):
    """The stage in motion under a force that is not measured, measured by a sensor with noise."""
    drive = STAGE.with_effects(*SENSORS[request.param])
    rng = np.random.default_rng(8)
    Fc, v0 = float(STAGE.friction.Fc), 0.5
    noise, push = 2e-7, 0.01 * Fc
    u = (1.3 * Fc + push * rng.standard_normal(N)) / float(STAGE.motor_constant)
    start = {"x0": 0.0, "v0": v0, "z0": Fc / float(STAGE.friction.sigma0)}
    run = simulate(drive, u, RATE, substeps=1, **start)
    integrated = request.param == "velocity"
    (own,) = sensor_noise(rng.standard_normal((1, N)), np.array([integrated]))
    measured = run.measured + noise * own
    force = jnp.full(N, 1.3 * Fc)
    at = tuple(jnp.asarray(value) for value in start.values())
    found = kalman_filter(
        drive,
        force,
        measured,
        DT,
        jnp.asarray(noise),
        jnp.asarray(push),
        at,
        (jnp.asarray(1e-9), jnp.asarray(1e-9)),
        integrated=integrated,
    )
    return drive, force, measured, at, found


def test_innovations_are_white_and_of_the_variance_it_reports(filtered):
    found = filtered[-1]
    unit = np.asarray(found.innovation / jnp.sqrt(found.variance))
    assert abs(np.mean(unit**2) - 1.0) < 3.0 * np.sqrt(2.0 / N)
    for lag in (1, 2, 5, 20):
        assert abs(np.mean(unit[lag:] * unit[:-lag])) < 3.0 / np.sqrt(N), lag


def test_given_gains_lead_from_positions_to_innovations_and_back(filtered):
    drive, force, measured, at, found = filtered
    innovation = predicted_with(drive, force, measured, DT, found.gain, at)
    np.testing.assert_allclose(innovation, found.innovation, atol=1e-12)
    np.testing.assert_allclose(driven_by(drive, force, innovation, DT, found.gain, at), measured, atol=1e-12)


def test_a_filter_that_loses_the_machine_comes_back():
    """A model that sticks where the machine creeps: its covariance shrinks, and it corrects less and less."""
    rng, Fc = np.random.default_rng(8), float(STAGE.friction.Fc)
    stuck = dataclasses.replace(STAGE, friction=dataclasses.replace(STAGE.friction, Fc=1.5 * Fc, Fs=2.0 * Fc))
    force = jnp.full(N, 1.05 * Fc)
    start = (jnp.asarray(0.0), jnp.asarray(0.0), jnp.asarray(0.0))
    noise = 2e-7
    measured = simulate(STAGE, force / STAGE.motor_constant, RATE, substeps=1).measured
    x = jnp.asarray(measured + noise * rng.standard_normal(N))
    known = (jnp.asarray(1e-9), jnp.asarray(1e-9))

    def left(drive, recovers):
        found = kalman_filter(
            drive, force, x, DT, jnp.asarray(noise), jnp.asarray(0.002 * Fc), start, known, recovers=recovers
        )
        return found, float(np.sqrt(np.mean(found.innovation[N // 2 :] ** 2))) / noise

    (alone, lost), (found, back) = left(stuck, False), left(stuck, True)
    assert lost > 100.0 and back < 0.1 * lost
    assert np.all(np.isfinite(found.gain)) and np.all(np.isfinite(found.variance))
    # A true machine is never lost: nothing changes.
    (alone, _), (found, _) = left(STAGE, False), left(STAGE, True)
    np.testing.assert_allclose(found.gain, alone.gain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.variance, alone.variance, rtol=1e-9)


@pytest.mark.parametrize(("size", "loses"), [(8.0, False), (11.0, True)])
def test_one_reading_must_be_far_off_to_lose_the_machine(size, loses):
    """Its square, over ten samples, against nine times the variance."""
    force, start = jnp.full(N, 1.3 * float(STAGE.friction.Fc)), tuple(map(jnp.asarray, (0.0, 0.0, 0.0)))
    x = np.array(simulate(STAGE, force / STAGE.motor_constant, RATE, substeps=1).measured)
    known = (jnp.asarray(1e-9), jnp.asarray(1e-9))

    def filtered(x, recovers):
        numbers = (jnp.asarray(2e-7), jnp.asarray(0.002 * float(STAGE.friction.Fc)))
        return kalman_filter(STAGE, force, jnp.asarray(x), DT, *numbers, start, known, recovers=recovers)

    x[N // 2] += size * float(np.sqrt(filtered(x, False).variance[N // 2]))
    own, alone = filtered(x, True), filtered(x, False)
    assert np.allclose(own.gain, alone.gain, rtol=1e-6, atol=1e-12) != loses
