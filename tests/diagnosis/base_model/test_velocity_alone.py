"""The base model of a velocity alone, found by observers with given gains."""

from helpers_estimation import base_fit
from helpers_velocity import DRIVE, FRICTION, INERTIA, OFFSET, recordings_of_speed

from frictionjax.physics import Drive, LuGre, VelocityOffset


def test_an_integral_that_drifts_costs_the_bristles_nothing():
    """Bristles that followed the drift would pull at a machine in stick, and least squares would damp them as much as
    it may: eight times as much as they are."""
    near = LuGre(**(FRICTION | {"sigma0": 4000.0, "sigma1": 6.0, "Fc": 0.75, "Fs": 0.9, "vs": 0.1}))
    start = Drive(1.1 * INERTIA, near, 1.0).with_effects(VelocityOffset())
    drive = base_fit([start], recordings_of_speed(DRIVE), encoder_step=None).judgement.drive
    (sensor,) = drive.effects
    found = {"J": drive.J, "offset": sensor.offset, "sigma1": drive.friction.sigma1, "Fc": drive.friction.Fc}
    true = FRICTION | {"J": INERTIA, "offset": OFFSET}
    off = {name: abs(float(value) / true[name] - 1.0) for name, value in found.items()}
    assert off["J"] < 0.002 and off["Fc"] < 0.002 and off["offset"] < 0.05 and off["sigma1"] < 0.4, off
