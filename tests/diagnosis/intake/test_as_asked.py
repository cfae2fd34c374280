"""The user accepts or rejects a name, and the rest is judged again."""

import pytest
from helpers_arm import swings

from frictionjax.core import InputError
from frictionjax.diagnosis.intake.as_asked import accepted, left_out_as_asked
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.recordings import Case, Given, GivenEffect, GivenModel, Plant

CASE = Case("arm", Plant(1.0, "rad", "N*m", "N*m"), swings(seconds=3.0))


def test_what_is_accepted_is_part_of_the_base_model_with_its_size_free():
    starting = starting_point(accepted(CASE, ["gravity_pendulum"]))
    assert [effect.name for effect in starting.own.effects] == ["gravity_pendulum"]
    assert not starting.own.fixed
    assert [effect.name for effect in starting.start.drives[0].effects] == ["gravity_pendulum"]


def test_what_the_model_of_the_case_says_stays():
    gravity = GivenEffect("gravity_pendulum", values={"sine": Given(9.0, True)})
    case = Case("arm", CASE.plant, CASE.recordings, GivenModel({"J": Given(0.3)}, (gravity,)))
    found = accepted(case, ["gravity_pendulum", "constant_load", "constant_load"]).model
    assert found is not None and found.parameters == {"J": Given(0.3)}
    assert found.effects == (gravity, GivenEffect("constant_load"))
    assert accepted(case, []) is case


def test_what_is_rejected_says_so():
    assert left_out_as_asked(["ripple"]) == {"ripple": "it is left out, as asked"}
    assert left_out_as_asked([]) == {}


@pytest.mark.parametrize("ask", [lambda name: accepted(CASE, [name]), lambda name: left_out_as_asked([name])])
def test_a_name_that_is_not_in_the_catalogue_is_refused_with_the_nearest(ask):
    with pytest.raises(InputError, match=r'"riple" is no effect of the catalogue\. Did you mean "ripple"'):
        ask("riple")
