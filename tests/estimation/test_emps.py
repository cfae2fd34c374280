"""The real ball-screw drive EMPS through the public verbs: its published parameters, and its other recording."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import frictionjax as fj
from frictionjax.physics.effects.constant_load import ConstantLoad
from frictionjax.physics.effects.direction_asymmetry import ViscousAsymmetry
from frictionjax.simulation import observer_gains, predict_ahead

CASE = Path(__file__).parents[3] / "shared" / "real" / "emps" / "case.toml"
MASS = 95.15
"""kg, by least squares on the inverse dynamics with unequal viscous friction (Janot, Gautier, Brunot, 2019)."""
SYMMETRIC = 0.103
"""mm: error 0.1 s ahead on the pulses file of the published model that is alike in both directions."""
GUESS = fj.Drive(50.0, fj.LuGre(sigma0=1e6, sigma1=1e3, sigma2=100.0, Fc=40.0, Fs=50.0, vs=0.01), 35.1507)


def ahead(drive, recording):
    """RMS error at 0.1 s, in mm, from a causal observer of 50 Hz, restarted every 50 ms."""
    dt, far = 1.0 / recording.sample_rate, round(0.1 * recording.sample_rate)
    speed = (recording.x[10] - recording.x[0]) / (10 * dt)
    bent = np.sign(speed) * drive.friction.Fc / drive.friction.sigma0
    force = drive.applied_force(jnp.asarray(recording.u), jnp.asarray(dt))
    start = (recording.x[0], speed, bent)
    x = predict_ahead(
        drive,
        force,
        recording.x,
        dt,
        observer_gains(50.0, dt),
        start,
        horizon=far,
        stride=far // 2,
        substeps=2,
    )
    stated = slice(far, None, far // 2)
    return 1e3 * float(np.sqrt(np.mean((np.asarray(x) - recording.x)[stated] ** 2)))


@pytest.mark.slow
@pytest.mark.skipif(not CASE.is_file(), reason="the recordings are not here")
def test_the_ball_screw_drive():
    case = fj.load_case(CASE)
    (train,), (test,) = case.fit_recordings, case.holdout_recordings
    found = fj.fit(
        GUESS.with_effects(ConstantLoad(), ViscousAsymmetry()), [train], encoder_step=case.plant.encoder_step
    )
    assert found.parameters["J"].value == pytest.approx(MASS, rel=0.02)
    assert ahead(found.drive, test) < SYMMETRIC
