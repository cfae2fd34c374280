"""Exchange: what was named first makes way for its twin when that does better beside what was named later."""

import pytest
from helpers_selection import LAG, LOAD, SILENT, a_round, with_effect, world

from frictionjax.diagnosis.exchange import exchanged, taken_for
from frictionjax.diagnosis.floor import answer_to_force
from frictionjax.diagnosis.refit import Refitted
from frictionjax.physics import catalogue


@pytest.fixture(scope="module")
def two():
    """A plant with a load and a lag of the drive, the base model, and its sizes."""
    return world(LOAD, LAG)


def _again(known, asked, scales):
    """Refits of what is `known` here among the names, with tests that all of them pass; `asked` is told the names."""

    def again(model, names):
        asked.append(names)
        found = [
            a_round(model, with_effect(model, key, scales), key) for key in known if SILENT[key].name in names
        ]
        return [trial for step in found for trial in step.trials], [
            Refitted(step.accepted.trial, step.accepted.model) for step in found
        ]

    return again


def test_what_is_taken_for_an_effect():
    """Whichever of the two says so; and an effect is its own twin, for its other forms."""
    assert "constant_load" in taken_for("gravity_pendulum")
    assert "gravity_pendulum" in taken_for("constant_load")
    for name in catalogue():
        assert name in taken_for(name)
        assert all(name in taken_for(other) for other in taken_for(name))


def test_a_pendulum_makes_way_for_the_load_that_it_stood_in_for(two):
    """Beside the lag the load predicts better; the moves are long enough to tell."""
    base, scales = two
    first = with_effect(base, "pendulum", scales)
    steps = [a_round(base, first, "pendulum"), a_round(first, with_effect(first, "lag", scales), "lag")]
    asked = []
    found = exchanged(
        steps, scales, answer_to_force(base.joint, base.fitted.vector), _again(["load"], asked, scales)
    )
    assert [step.accepted.effect for step in found] == ["drive_lag", "constant_load"]
    assert found[0].before is base
    assert found[1].rivals == ()
    assert asked == [taken_for("gravity_pendulum")]
    model = found[1].accepted.model
    assert [effect.name for effect in model.joint.setting.drive.effects] == ["drive_lag", "constant_load"]


def test_twins_that_the_others_do_not_separate_are_told_together(two):
    """A lag of a sixteenth of a sample is a delay of it: with the experiment's two refits in the round."""
    base, scales = two
    first = with_effect(base, "lag", scales)
    steps = [a_round(base, first, "lag"), a_round(first, with_effect(first, "load", scales), "load")]
    found = exchanged(
        steps, scales, answer_to_force(base.joint, base.fitted.vector), _again(["delay"], [], scales)
    )
    assert found[0].accepted.effect == "constant_load"
    assert {found[1].accepted.effect, *found[1].rivals} == {"drive_lag", "delay"}
    assert {refit.effect for refit in found[1].refits} == {"drive_lag", "delay"}
    assert found[1].accepted in found[1].refits


def test_the_true_effect_stays_beside_a_twin_that_does_worse(two):
    """A spring is no load."""
    base, scales = two
    first = with_effect(base, "load", scales)
    steps = [a_round(base, first, "load"), a_round(first, with_effect(first, "lag", scales), "lag")]
    asked = []
    found = exchanged(
        steps, scales, answer_to_force(base.joint, base.fitted.vector), _again(["spring"], asked, scales)
    )
    assert [step.accepted.effect for step in found] == ["constant_load", "drive_lag"]
    assert found[0].rivals == ()
    assert asked == [taken_for("constant_load")]
