"""The user's own model as the base model: what it knows is there, what it fixes stays, and what it lacks is found."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import pytest
from helpers_arm import ARM, SINE, swings
from helpers_plants import effect

from frictionjax.core import InputError, silent
from frictionjax.diagnosis import diagnose
from frictionjax.diagnosis.base_model.fit_base import base_of, parameters_of
from frictionjax.diagnosis.intake.own_model import own_model
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.estimation.parameters import part_of
from frictionjax.recordings import Case, Given, GivenEffect, GivenModel, Plant

UNITS = {"force": "N*m", "position": "rad", "input": "N*m"}
LUGRE = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
NAMED = GivenModel(effects=(GivenEffect("gravity_pendulum"),))


@pytest.fixture(scope="module")
def arm():
    """The arm's recordings, and nothing known of it."""
    return Case("arm", Plant(1.0, "rad", "N*m", "N*m"), swings())


def _with(case, **parts):
    return dataclasses.replace(case, model=GivenModel(**parts))


def test_what_is_given_is_in_the_drive(arm):
    """Values, effects and what is fixed; static friction that is not given keeps its ratio."""
    ripple = GivenEffect("ripple", values={"period": Given(0.3), "sine": Given(0.1, True)})
    case = _with(
        arm, parameters={"J": Given(0.3), "Fc": Given(0.7, True)}, effects=(GivenEffect("delay"), ripple)
    )
    own = own_model(case)
    assert own.fixed == {"friction.Fc", "effects.1.sine"} and own.open == {0} and not own.complete
    drive = own.applied(ARM)
    assert (float(drive.J), float(drive.friction.Fc)) == (0.3, 0.7)
    assert float(drive.friction.Fs) == pytest.approx(0.7 * 0.8 / 0.65)
    assert float(drive.friction.sigma0) == 900.0
    assert [one.name for one in drive.effects] == ["delay", "ripple"]
    assert float(part_of(drive, "effects.1.sine")) == 0.1
    static = own_model(_with(arm, parameters={"Fs": Given(1.6)})).applied(ARM).friction
    assert (float(static.Fs), float(static.Fc)) == (1.6, pytest.approx(1.3))


def test_a_model_with_all_values_is_complete(arm):
    values = {name: Given(float(getattr(ARM.friction, name))) for name in LUGRE} | {"J": Given(0.35)}
    gravity = GivenEffect("gravity_pendulum", values={"sine": Given(SINE)})
    assert own_model(_with(arm, parameters=values, effects=(gravity,))).complete
    assert not own_model(_with(arm, parameters=values, effects=(GivenEffect("gravity_pendulum"),))).complete
    assert not own_model(arm).complete


def test_a_known_inertia_is_fixed(arm):
    heavy = dataclasses.replace(arm, plant=dataclasses.replace(arm.plant, inertia=0.4))
    assert own_model(heavy).fixed == {"J"} and float(own_model(heavy).applied(ARM).J) == 0.4
    agreed = _with(heavy, parameters={"J": Given(0.4)})
    assert own_model(agreed).fixed == {"J"}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"parameters": {"fc": Given(1.0)}}, "`fc` is no parameter of the base model. Did you mean Fc?"),
        ({"parameters": {"J": Given(-1.0)}}, "J = -1 is out of its range (0 to inf)"),
        ({"parameters": {"vs": Given(0.0)}}, "vs = 0 is out of its range"),
        (
            {"parameters": {"Fc": Given(1.0), "Fs": Given(0.9)}},
            "Fs = 0.9 is not above Coulomb friction Fc = 1",
        ),
        (
            {"effects": (GivenEffect("gravity"),)},
            '"gravity" is no effect of the catalogue. Did you mean gravity_pend',
        ),
        ({"effects": (GivenEffect("delay", form="Lag"),)}, '"Lag" is no form of delay. Its forms: Delay'),
        (
            {"effects": (GivenEffect("delay", values={"sine": Given(1.0)}),)},
            "`sine` is no parameter of delay",
        ),
        (
            {"effects": (GivenEffect("delay", values={"delay": Given(-1.0)}),)},
            "delay = -1 is out of its range",
        ),
        ({"effects": (GivenEffect("ripple"),)}, "ripple needs a value of period"),
        (
            {"parameters": {"J": Given(0.3)}, "plant": {"inertia": 0.4}},
            "J is 0.3 in the model, and the plant has",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused(arm, parts, words):
    own = dict(parts)
    plant = dataclasses.replace(arm.plant, **own.pop("plant", {}))
    case = dataclasses.replace(arm, plant=plant, model=GivenModel(source="case.toml", **own))
    with pytest.raises(InputError) as found:
        own_model(case)
    said = str(found.value)
    assert said.startswith("case.toml, [model]: ") and words in said and "\n" not in said


def test_gravity_that_is_known_to_act_is_found_and_what_is_fixed_stays(arm):
    """Of a size that leaves the fit without it in a wrong minimum: no strength is given, and inertia is."""
    case = dataclasses.replace(_with(arm, effects=NAMED.effects, parameters={"J": Given(0.36, True)}))
    starting = starting_point(case)
    for drive in starting.start.drives:
        assert float(part_of(drive, "effects.0.sine")) == pytest.approx(SINE, rel=0.02)
        assert float(drive.friction.Fc) == pytest.approx(0.65, rel=0.3)
    assert "As the case says, the base model contains gravity_pendulum." in starting.notes
    with ThreadPoolExecutor(2) as executor:
        model = base_of(starting, executor, silent)
    found = parameters_of(model, UNITS)
    assert "J" not in found and float(model.judgement.drive.J) == pytest.approx(0.36, rel=1e-12)
    assert found["sine"].value == pytest.approx(SINE, rel=0.01)
    assert found["Fc"].value == pytest.approx(0.65, rel=0.1)


@pytest.mark.slow
def test_what_the_user_s_model_lacks_is_named():
    """A ripple beside gravity; gravity itself is never named. The model as given errs more than the refitted one."""
    ripple = effect("Ripple", sine=0.12, period=0.31)
    values = {name: Given(1.2 * float(getattr(ARM.friction, name))) for name in LUGRE}
    gravity = GivenEffect("gravity_pendulum", values={"sine": Given(0.95 * SINE)})
    model = GivenModel(values | {"J": Given(0.4)}, (gravity,))
    case = Case("arm", Plant(1.0, "rad", "N*m", "N*m"), swings(ARM.with_effects(ripple)), model)
    found = diagnose(case)
    for one in found.recordings:
        errors = (one.prediction_rmse_extended, one.prediction_rmse_base, one.prediction_rmse_given)
        assert list(errors) == sorted(errors), one.name
        assert one.free_run_rmse_given is not None
    assert "with your model as given it is" in found.summary
    assert found.verdict == "named"
    assert [one.effect for one in found.missing] == ["ripple"]
    assert found.extended["period"].value == pytest.approx(0.31, rel=0.01)
    assert found.base["sine"].value == pytest.approx(SINE, rel=0.02)
    reasons = {one.effect: one.reason for one in found.candidates}
    assert reasons["gravity_pendulum"] == "it is part of the base model"
