"""Exchange: what was named first makes way for its twin when that does better beside what was named later."""

import pytest
from helpers_selection import SILENT, a_round, with_effect, world

from frictionjax.diagnosis.evidence.noise_floor import answer_to_force
from frictionjax.diagnosis.refitting.refitted import Refitted
from frictionjax.diagnosis.selection.decide import dropping
from frictionjax.diagnosis.selection.swap import exchanged, instead, taken_for
from frictionjax.physics import catalogue


@pytest.fixture(scope="module")
def two():
    """A plant with a load and a lag of the drive, the base model, and its sizes."""
    return world("load", "lag")


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


def _exchanged(two, named, known):
    """Rounds in which the effects `named` were accepted one after the other, and what exchange makes of them when it
    can refit the `known` ones; with the names for which it asked."""
    base, scales = two
    steps, before = [], base
    for key in named:
        steps.append(a_round(before, with_effect(before, key, scales), key))
        before = steps[-1].accepted.model
    asked = []
    answer = answer_to_force(base.joint, base.fitted.vector)
    return exchanged(steps, scales, answer, _again(known, asked, scales)), asked


def test_what_is_taken_for_an_effect():
    """Whichever of the two says so; and an effect is its own twin, for its other forms."""
    assert "constant_load" in taken_for("gravity_pendulum")
    assert "gravity_pendulum" in taken_for("constant_load")
    for name in catalogue():
        assert name in taken_for(name)
        assert all(name in taken_for(other) for other in taken_for(name))


@pytest.mark.slow
def test_a_pendulum_makes_way_for_the_load_that_it_stood_in_for(two):
    """Beside the lag the load predicts better; the moves are long enough to tell."""
    found, asked = _exchanged(two, ["pendulum", "lag"], ["load"])
    assert [step.accepted.effect for step in found] == ["drive_lag", "constant_load"]
    assert found[0].before is two[0]
    assert found[1].rivals == ()
    assert asked == [taken_for("gravity_pendulum")]
    model = found[1].accepted.model
    assert [effect.name for effect in model.joint.drive.effects] == ["drive_lag", "constant_load"]


def test_twins_that_the_others_do_not_separate_are_told_together(two):
    """A lag of a sixteenth of a sample is a delay of it: with the experiment's two refits in the round."""
    found, _ = _exchanged(two, ["lag", "load"], ["delay"])
    assert found[0].accepted.effect == "constant_load"
    assert {found[1].accepted.effect, *found[1].rivals} == {"drive_lag", "delay"}
    assert {refit.effect for refit in found[1].refits} == {"drive_lag", "delay"}
    assert found[1].accepted in found[1].refits


def test_the_true_effect_stays_beside_a_twin_that_does_worse(two):
    """A spring is no load."""
    found, asked = _exchanged(two, ["load", "lag"], ["spring"])
    assert [step.accepted.effect for step in found] == ["constant_load", "drive_lag"]
    assert found[0].rivals == ()
    assert asked == [taken_for("constant_load")]


def _instead(two, first, second, known):
    """What becomes of the `first` name when the `second` is refused beside it."""
    base, scales = two
    steps = [a_round(base, with_effect(base, first, scales), first)]
    begun = steps[0].accepted.model
    refused = dropping(a_round(begun, with_effect(begun, second, scales), second), "explains too little")
    answer = answer_to_force(base.joint, base.fitted.vector)
    return instead(steps, refused, scales, answer, _again(known, [], scales))


def test_a_second_effect_refused_beside_a_wrong_name_brings_in_the_true_one(two):
    """Beside the pendulum that stands in for the load nothing else may be named; with the load both are."""
    found = _instead(two, "pendulum", "lag", ["load"])
    assert [step.accepted.effect for step in found] == ["drive_lag", "constant_load"]
    assert found[-1].accepted.model.fitted.misfit < 0.2 * found[0].before.fitted.misfit


def test_what_is_refused_beside_a_true_name_stays_refused(two):
    """The load is what it seems, and trying the lag out beside it does not let the lag in."""
    assert _instead(two, "load", "lag", ["spring"]) is None


def test_a_wrong_name_stays_where_nothing_is_taken_for_it(two):
    """What was refused is then not named either."""
    assert _instead(two, "lag", "pendulum", []) is None


@pytest.mark.parametrize(
    ("what", "instead_of_it"),
    [("ENOUGH_SHARE", 2.0), ("reviewed", lambda steps, *_: steps[:1])],
    ids=["all but nearly all", "one is not needed"],
)
def test_a_name_comes_in_only_with_nearly_all_explained_and_both_needed(
    two, monkeypatch, what, instead_of_it
):
    """The same rounds as above, with a share that cannot be had, or with a review that drops one."""
    monkeypatch.setattr(f"frictionjax.diagnosis.selection.swap.{what}", instead_of_it)
    assert _instead(two, "pendulum", "lag", ["load"]) is None
