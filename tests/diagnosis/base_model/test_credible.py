"""The alarm: a base fit that predicts no better than no model is not scored."""

import dataclasses

import numpy as np
import pytest
from helpers_estimation import PLANT, base_fit, small_case

from frictionjax.core import InputError
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.base_model.credibility import Credibility, credibility, energy_and_lead
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.evidence import observed
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import innovation_gain, observer_gains


def with_input(case, change):
    """The case with every input changed."""
    return dataclasses.replace(
        case, recordings=tuple(dataclasses.replace(r, u=change(r.u)) for r in case.recordings)
    )


def fitted(case):
    """Its base fit."""
    return base_fit(starting_point(case).start.drives, case.fit_recordings + case.holdout_recordings)


def test_a_good_base_fit_is_credible_and_that_of_a_reversed_input_is_not():
    case = small_case(seconds=2.2)
    good = credibility(fitted(case))
    assert good.is_credible()
    assert good.energy > 0.99
    assert good.failed == ()
    reversed_input = credibility(fitted(with_input(case, np.negative)))
    assert not reversed_input.is_credible()
    assert reversed_input.energy < 0.0
    assert reversed_input.failed


@pytest.mark.parametrize(
    ("energy", "lead", "expected"),
    [(0.9, -5.0, True), (0.1, 5.0, True), (0.1, 1.0, False), (-0.3, -4.0, False)],
)
def test_either_half_of_the_energy_or_most_of_the_time_makes_it_credible(energy, lead, expected):
    assert Credibility(energy, lead, ()).is_credible() is expected


def test_noise_does_not_outvote_the_few_blocks_that_show_anything():
    """As under an encoder of 12 bit: what no model misses in one block of a hundred, and noise in all the others."""
    rng = np.random.default_rng(4)
    noise = 1.0 + 0.1 * rng.standard_normal((1, 1000))
    none = np.where(np.arange(1000) % 100 == 0, noise + 2.0, noise)
    assert energy_and_lead(none, noise, np.full((1, 1000), 100.0), Rule())[0] > 0.9
    assert energy_and_lead(noise, noise, np.full((1, 1000), 100.0), Rule())[0] == 0.0
    assert energy_and_lead(noise, none, np.full((1, 1000), 100.0), Rule())[0] <= 0.0


def test_without_a_model_noise_alone_has_unit_power():
    rng = np.random.default_rng(3)
    n = 40_000
    still = Recording("a", 1000.0, np.ones(n), 1e-6 * rng.standard_normal(n))
    batch = make_batch((still,), encoder_step=1e-12)
    evidence = observed(batch, 50.0)
    gains, e = observer_gains(50.0, 1e-3), np.asarray(evidence.without_model())[0, 1000:]
    # Correlated over the observer's memory of some ten samples, and the noise level has an error of its own.
    assert np.mean(e**2) == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 * (10.0 + 2.626) / n))
    assert float(innovation_gain(gains)) > 1.0


def _case(u, x, **plant):
    recordings = (Recording("a", 1000.0, u, x), Recording("b", 1000.0, u, x, role="holdout"))
    return Case("bench", Plant(**plant), recordings)


T = np.arange(2000) / 1000.0
U, X = np.sin(9.0 * T), 0.1 * np.cos(7.0 * T)
BAD = {
    "no motion": (_case(U, 0.0 * X + 3.0), "recording a: x is constant.*leave the recording out"),
    "no input": (_case(0.0 * U, X), "recording a: u is zero throughout"),
    "not a number": (_case(U, np.where(T > 1.0, np.nan, X)), "999 values of x are not finite, the first at"),
    "infinite": (_case(np.where(T > 1.9985, np.inf, U), X), "1 values of u are not finite"),
    "negative constant": (_case(U, X, motor_constant=-2.0), "motor constant is -2.*reverse the sign of u"),
    "noise alone": (
        _case(U, np.random.default_rng(1).standard_normal(2000)),
        "moves in none of the recordings.*Drive it harder",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_holds_nothing_is_refused_with_a_cure(name):
    case, words = BAD[name]
    with pytest.raises(InputError, match=words):
        diagnose(case)


@pytest.mark.slow
def test_a_reversed_input_is_said_first_and_nothing_is_named():
    found = diagnose(with_input(small_case(), np.negative))
    assert (found.verdict, found.missing) == ("unknown", ())
    assert found.summary.startswith("Set scale = {u = -1.0}: a positive input moves x backwards")
    assert "Set scale = {u = -1.0}" in found.warnings[0]
    assert not found.was_diagnosed
    assert all(not row.tested for row in found.candidates)
    assert "cannot be tested" in found.explain("delay")


@pytest.mark.slow
def test_an_inertia_that_contradicts_the_motor_constant_is_said_first():
    case = small_case()
    wrong = dataclasses.replace(case, plant=dataclasses.replace(case.plant, inertia=1000.0 * float(PLANT.J)))
    found = diagnose(wrong)
    assert (found.verdict, found.missing) == ("unknown", ())
    assert found.summary.startswith("Correct the inertia or the motor constant")
    assert "an inertia of 0.03 instead of 30" in found.warnings[0]


@pytest.mark.slow
def test_an_input_that_does_not_drive_the_machine_is_said_first():
    found = diagnose(with_input(small_case(), lambda u: np.roll(u[::-1], 777)))
    assert (found.verdict, found.missing) == ("unknown", ())
    assert "Check that u is what drives x" in found.warnings[0]
    assert found.summary.startswith("Check that u is what drives x")
