"""A servo drive logs torque and speed, no position: what is missing is named, and nothing where nothing is."""

import pytest
from helpers_plants import effect
from helpers_velocity import DRIVE, INERTIA, NOISE, OFFSET, RATE, recordings_of_speed

import frictionjax as fj

HIDDEN = {
    "nothing": ("", {}, {}),
    "asymmetry": ("DirectionAsymmetry", {"coulomb": 0.15}, {}),
    "cogging": ("Ripple", {"sine": 0.2}, {"period": 1.3}),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", HIDDEN)
def test_what_is_missing_is_named(kind):
    form, truth, more = HIDDEN[kind]
    hidden = (effect(form, **truth, **more),) if form else ()
    plant = fj.Plant(motor_constant=1.0, position_unit="rad", force_unit="N*m")
    case = fj.Case(kind, plant, recordings_of_speed(DRIVE.with_effects(*hidden)))
    found = fj.diagnose(case, progress=False)
    assert [one.effect for one in found.missing] == [one.name for one in hidden]
    assert found.verdict == ("named" if form else "adequate")
    for one in found.missing:
        for name, value in truth.items():
            estimate = one.parameters[name]
            assert abs(estimate.value - value) < 4.0 * estimate.stderr and estimate.stderr < 0.02 * value
    for one in found.recordings:
        # The drift of the integral in 0.1 s, and what the noise of the sensor leaves of the velocity.
        assert 1.0 < one.prediction_rmse_extended / one.noise_floor < 5.0
        assert one.one_sample_floor == pytest.approx(NOISE / RATE / 2.0**0.5, rel=0.05)
    for name, value in (("J", INERTIA), ("offset", OFFSET)):
        estimate = found.extended[name]
        assert abs(estimate.value - value) < 4.0 * estimate.stderr and estimate.stderr < 0.02 * value
