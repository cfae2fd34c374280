"""The experiment that a diagnosis asks for: done on the true machine, it tells the names apart."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, RATE, closed_loop, moves, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.recordings import Case, Plant

LATE = 4  # samples
DELAYED = PLANT.with_effects(effect("Delay", delay=LATE / RATE))


def gentle():
    """Slow moves and weak noise: that the input comes late is seen, how late each frequency is not."""
    there = moves(6.0, (0.3, -0.1, 0.02, 0.2, 0.0), (0.6, 0.8, 0.9, 0.7, 0.7))
    back = moves(6.0, (0.1, -0.2, 0.12, 0.0), (0.8, 0.7, 0.9, 0.7))
    return (
        closed_loop("there", there, seed=1, late=LATE),
        open_loop("stick", stick_noise(3.0, level=0.03), seed=5, drive=DELAYED),
        closed_loop("back", back, seed=2, late=LATE, role="holdout"),
    )


def case(*recordings):
    plant = Plant(motor_constant=float(PLANT.motor_constant), position_unit="rad", encoder_step=FINE)
    return Case("gentle", plant, recordings)


@pytest.mark.slow
def test_what_is_asked_for_tells_the_names_apart():
    recordings = gentle()
    before = diagnose(case(*recordings)).missing[0]
    assert set(before.effect_class) == {"delay", "drive_lag"}
    asked = before.next_experiment
    assert asked is not None and set(asked.between) == {"delay", "drive_lag"}
    # As asked: that input, for that long, on the true machine; held for two samples of ours.
    u = np.repeat(np.tile(asked.u, int(np.ceil(asked.seconds * asked.sample_rate / asked.u.size))), 2)
    assert 2.0 * asked.sample_rate == RATE
    done = open_loop("asked", u, seed=9, drive=DELAYED)
    again = open_loop("again", u[::-1].copy(), seed=10, drive=DELAYED)
    after = diagnose(case(*recordings, done, dataclasses.replace(again, role="holdout"))).missing[0]
    assert after.effect == "delay" and after.effect_class == ("delay",)
    stated = after.parameters["delay"]
    assert abs(stated.value - LATE / RATE) < 4.0 * stated.stderr + 1e-6


def test_an_effect_that_kept_its_place_is_the_one_that_is_told_apart():
    """Compared again beside a later one, it is not the last of the drive."""
    drive = PLANT.with_effects(effect("Delay", delay=1e-3), effect("ConstantLoad", load=0.1))
    model = SimpleNamespace(judgement=SimpleNamespace(drive=drive))
    for name, own in zip(("delay", "constant_load"), drive.effects, strict=True):
        refitted = SimpleNamespace(effect=name, model=model)
        assert Refitted.own_effect.fget(refitted) is own
