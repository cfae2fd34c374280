"""The screening test says the same in any units of position, force and input."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, closed_loop, moves, open_loop, stick_noise
from helpers_plants import effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import try_form
from frictionjax.estimation.data.batch import make_batch, noise_level
from frictionjax.estimation.objective.robust import robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics import Drive, LuGre

FORMS = ("ConstantLoad", "GravityPendulum", "Delay", "WarmupByTemperature")
"""A force, one of an angle, an effect on the input, and one of which these recordings, without a temperature, show
nothing."""


def in_units(drive, position, force, signal):
    """The same `drive` where the numbers of positions, forces and inputs are so many times as large."""
    friction = drive.friction
    stiff = force / position
    return Drive(
        J=drive.J * stiff,
        motor_constant=drive.motor_constant * force / signal,
        friction=LuGre(
            **{name: getattr(friction, name) * stiff for name in ("sigma0", "sigma1", "sigma2")},
            Fc=friction.Fc * force,
            Fs=friction.Fs * force,
            vs=friction.vs * position,
        ),
    )


@pytest.fixture(scope="module")
def screened():
    """What the screening test says of some effects, by the factors of the units."""
    planted = PLANT.with_effects(effect("ConstantLoad", load=0.02))
    recordings = (
        open_loop("stick", stick_noise(1.2), seed=1, drive=planted),
        closed_loop("moves", moves(), seed=2),
    )

    def run(position, force, signal):
        drive = in_units(PLANT, position, force, signal)
        own = tuple(dataclasses.replace(r, x=r.x * position, u=r.u * signal) for r in recordings)
        batch = make_batch(own, encoder_step=FINE * position)
        present = present_model(*robust_posterior(drive, batch, np.zeros(2, bool)))
        scales = plant_scales(drive, batch) | {"stroke": 0.4 * position, "Fc/stroke": force / position}
        forms = [effect(name).in_turns_of(2.0 * np.pi * position) for name in FORMS]
        trials = [trial for form in forms for trial in try_form(present, [form], scales)[:1]]
        return present.misfit, trials

    return run


@settings(max_examples=4, derandomize=True)
@given(st.tuples(*(st.floats(-6.0, 6.0) for _ in range(3))))
def test_the_screening_test_knows_no_units(screened, powers):
    misfit, trials = screened(1.0, 1.0, 1.0)
    other, again = screened(*(10.0**power for power in powers))
    assert other == pytest.approx(misfit, rel=1e-6)
    for one, two in zip(trials, again, strict=True):
        assert one.effect == two.effect
        assert two.gain == pytest.approx(one.gain, rel=1e-4, abs=1e-7)
        assert two.p_value == pytest.approx(one.p_value, rel=1e-4)
        assert [two.shown, two.absorbed] == pytest.approx([one.shown, one.absorbed], rel=1e-4, abs=1e-15)


def test_what_the_recordings_cannot_show_is_not_significant(screened):
    """What is left of it is rounding."""
    trial = screened(1e6, 1.0, 1.0)[1][-1]
    assert trial.shown < 1e-12
    assert trial.p_value == 1.0


@pytest.mark.parametrize("unit", [1e-15, 1e-6, 1.0, 1e6])
@pytest.mark.parametrize("still", [False, True])
def test_the_noise_level_is_in_the_units_of_the_recording(unit, still):
    recording = open_loop("stick", stick_noise(0.3), seed=1)
    x = np.full(recording.x.size, 0.3) if still else recording.x
    levels = [noise_level(dataclasses.replace(recording, x=x * factor)) for factor in (1.0, unit)]
    assert levels[1] == pytest.approx(unit * levels[0], rel=1e-9)
