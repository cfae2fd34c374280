"""A coarse sensor: the base model of a machine whose friction falls steeply with velocity is found, and is adequate."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, VOLT, base_fit, closed_loop, moves, truth

from frictionjax.diagnosis.base_model.fit_base import parameters_of, said_of_errors
from frictionjax.diagnosis.base_model.likeliest import likeliest_parameters, said_of_the_sensor
from frictionjax.diagnosis.evidence.noise_floor import answer_to_force, floor_of, quietness
from frictionjax.diagnosis.evidence.pace import at_pace, pace_of
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective.robust import robust_posterior
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate

NOISE = 2e-5
"""Of the sensor, rad: a tenth of the friction more would hide below it in the usual observer."""
UNITS = {"force": "N*m", "position": "rad", "input": "V"}
STEEP = dataclasses.replace(
    PLANT, friction=dataclasses.replace(PLANT.friction, Fs=1.4 * PLANT.friction.Fc, vs=0.05)
)


def _slow(amplitude, frequency, seconds=3.0):
    return amplitude * np.sin(2.0 * np.pi * frequency * np.arange(round(2000.0 * seconds)) / 2000.0)


@pytest.fixture(scope="module")
def base():
    common = {"drive": STEEP, "noise": NOISE, "substeps": 4}
    recordings = (
        closed_loop("moves", moves(), seed=1, **common),
        closed_loop("slow", _slow(0.05, 0.5), seed=2, **common),
        closed_loop("slower", _slow(0.02, 0.4), seed=3, **common),
        closed_loop("others", moves(positions=(-0.25, 0.1, 0.07)), seed=4, role="holdout", **common),
        closed_loop("slow too", _slow(0.04, 0.6), seed=5, role="holdout", **common),
    )
    return base_fit((PLANT,), recordings)


def test_it_is_at_the_noise(base):
    answer = answer_to_force(base.posterior, base.fitted.vector)
    floor = floor_of(0.0, answer, quietness(base.judgement.power, answer, base.posterior))
    assert base.judgement.within(floor, Rule().limits.adequate) == (True, True)


def test_a_sentence_says_so(base):
    (said,) = said_of_the_sensor(base.posterior)
    assert f"{np.min(base.posterior.recordings.bandwidth):.3g} Hz" in said
    fine, _ = robust_posterior(PLANT, base.posterior.batch, base.judgement.held_out)
    assert said_of_the_sensor(fine) == ()


def test_its_parameters_are_those_of_the_machine(base):
    """Of the steep fall too, which a fixed observer would make gentle."""
    found = parameters_of(base, UNITS)
    assert said_of_errors(base) == ""
    for name, value in truth(STEEP).items():
        estimate = found[name]
        if estimate.identified:
            assert abs(estimate.value - value) < 4.0 * estimate.stderr, (name, estimate, value)
    assert all(found[name].identified for name in ("J", "Fc", "Fs", "vs"))
    assert found["vs"].value == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_its_parameters_are_without_the_error_of_the_integration(seed):
    """At 500 Hz, where two steps a sample put sigma1 four standard errors off in each of these recordings."""
    rate = 500.0
    t = np.arange(2500) / rate
    u = VOLT * (1.6 * np.sin(2.0 * np.pi * 1.3 * t) + 0.4 * np.sin(2.0 * np.pi * 7.0 * t))
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(t.size)
    x = np.asarray(simulate(PLANT, u, rate, substeps=16).x) + noise
    batch, held_out = make_batch((Recording("pushes", rate, u, x),), encoder_step=FINE), np.array([False])
    pace = pace_of(PLANT, batch, held_out)
    posterior, vector = robust_posterior(PLANT, batch, held_out, pace=pace)
    found = likeliest_parameters(at_pace(posterior, pace, None), vector, UNITS)
    for name, value in truth(PLANT).items():
        assert abs(found[name].value - value) < 4.0 * found[name].stderr, (name, found[name], value)
