"""What an effect is commonly taken for is refitted in its place: once it is the best, and after another is named."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers_plants import effect
from helpers_selection import LAG, LOAD, Bench, with_effect, world

from frictionjax.core import silent
from frictionjax.diagnosis.effort import Effort, ScreeningEffort
from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.refitting.shortlist import confused_with
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.screening.try_catalogue import try_catalogue
from frictionjax.diagnosis.selection import refit_candidates
from frictionjax.diagnosis.selection.refit_candidates import CandidateRefitter
from frictionjax.diagnosis.selection.round import dropping
from frictionjax.diagnosis.selection.search import Search
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.robust import extend
from frictionjax.physics import catalogue

pytestmark = pytest.mark.untyped

FORCES = frozenset({"constant_load", "gravity_pendulum"})


@pytest.fixture(scope="module")
def two():
    """A plant with a load and a lag of the drive, the base model, and its sizes."""
    return world("load", "lag")


def _swapped(two, named, known):
    """What a swap makes of rounds in which the effects `named` were accepted, when it can refit the `known` ones; and
    the bench of it."""
    bench = Bench(*two, known)
    return bench.search.swap(bench.chain(*named)), bench


def test_what_is_confused_with_an_effect():
    """Whichever of the two says so; and an effect is its own twin, for its other forms."""
    assert "constant_load" in confused_with("gravity_pendulum")
    assert "gravity_pendulum" in confused_with("constant_load")
    # A wave that is longer than the stroke bends to any force of the position.
    assert confused_with("ripple") >= {"constant_load", "return_spring", "gravity_pendulum"}
    for name in catalogue():
        assert name in confused_with(name)
        assert all(name in confused_with(other) for other in confused_with(name))


@pytest.mark.slow
def test_a_pendulum_makes_way_for_the_load_that_it_stood_in_for(two):
    """Beside the lag the load predicts better; the moves are long enough to show it."""
    found, bench = _swapped(two, ["pendulum", "lag"], ["load"])
    assert [one.row.effect for one in found] == ["drive_lag", "constant_load"]
    assert bench.tables.step(found[0]).before is two[0]
    assert found[1].rivals == ()
    assert bench.asked == [confused_with("gravity_pendulum")]
    model = bench.model(found[1])
    assert [effect.name for effect in model.posterior.drive.effects] == ["drive_lag", "constant_load"]


def test_twins_that_the_others_do_not_separate_are_one_class(two):
    """A lag of a sixteenth of a sample is a delay of it: with the experiment's two refits in the round."""
    found, bench = _swapped(two, ["lag", "load"], ["delay"])
    assert found[0].row.effect == "constant_load"
    assert {found[1].row.effect, *found[1].rivals} == {"drive_lag", "delay"}
    step = bench.tables.step(found[1])
    assert {refit.effect for refit in step.refits} == {"drive_lag", "delay"}
    assert step.accepted in step.refits


def test_what_the_best_is_taken_for_is_refitted_though_its_first_step_was_not_worth_it(two):
    """Of a short list with room for one form; and it ends where a fit of it by itself ends."""
    model, scales = two
    effort = Effort(screening=ScreeningEffort(first_forms=1, linear_forms=0, related=0))
    others = frozenset(catalogue()) - FORCES
    with ThreadPoolExecutor(2) as executor:
        candidates = CandidateRefitter(
            executor, silent, 2.0 * np.pi, None, others, frozenset(), None, tuple, Rule(), effort
        )
        _, _, refits = candidates.beside(model, 0)
        barred = dataclasses.replace(candidates, barred=FORCES - {refits[0].effect}).beside(model, 0)[2]
    assert {one.effect for one in refits} == FORCES
    assert {one.effect for one in barred} == {refits[0].effect}
    for one in refits:
        name = {"constant_load": "load", "gravity_pendulum": "pendulum"}[one.effect]
        alone = with_effect(model, name, scales).fitted.misfit
        assert one.model.fitted.misfit < alone + 1e-3 * abs(alone), one.effect


def test_every_refit_comes_with_a_test_though_its_step_threw_the_motion_before(two, monkeypatch):
    """Beside the base model the pendulum's test says nothing here; beside the load's other parameters it does."""
    model, _ = two
    calls = []

    def throwing(*arguments, **options):
        calls.append(try_catalogue(*arguments, **options))
        dropped = {"gravity_pendulum"} if len(calls) == 1 else set()
        return [[trial for trial in some if trial.effect not in dropped] for some in calls[-1]]

    monkeypatch.setattr(refit_candidates, "try_catalogue", throwing)
    others = frozenset(catalogue()) - FORCES
    with ThreadPoolExecutor(2) as executor:
        candidates = CandidateRefitter(
            executor, silent, 2.0 * np.pi, None, others, frozenset(), None, tuple, Rule(), Effort()
        )
        _, trials, refits = candidates.beside(model, 0)
    assert len(calls) == 2
    assert {one.effect for one in refits} == FORCES == {trial.effect for trial in trials}


def test_the_true_effect_stays_beside_a_twin_that_does_worse(two):
    """A spring is no load."""
    found, bench = _swapped(two, ["load", "lag"], ["spring"])
    assert [one.row.effect for one in found] == ["constant_load", "drive_lag"]
    assert found[0].rivals == ()
    assert bench.asked == [confused_with("constant_load")]


def _instead(two, first, second, known, change=lambda search: search):
    """What becomes of the `first` name when the `second` is refused beside it, by a search with a `change`."""
    bench = Bench(*two, known)
    *chain, last = bench.chain(first, second)
    refused = dropping(last, "explains too little")
    return change(bench.search).instead(chain, refused), bench


def test_a_second_effect_refused_beside_a_wrong_name_brings_in_the_true_one(two):
    """Beside the pendulum that stands in for the load nothing else may be named; with the load both are."""
    found, bench = _instead(two, "pendulum", "lag", ["load"])
    assert [one.row.effect for one in found] == ["drive_lag", "constant_load"]
    assert bench.model(found[-1]).fitted.misfit < 0.2 * two[0].fitted.misfit


def test_what_is_refused_beside_a_true_name_stays_refused(two):
    """The load is what it seems, and trying the lag out beside it does not let the lag in."""
    assert _instead(two, "load", "lag", ["spring"])[0] is None


def test_a_wrong_name_stays_where_nothing_is_confused_with_it(two):
    """What was refused is then not named either."""
    assert _instead(two, "lag", "pendulum", [])[0] is None


def _resting(bench, model, added):
    """The `model` and the effect that is `added`, where a descent has come to rest."""
    posterior, vector = extend(model.posterior, model.fitted.vector, added, bench.scales)
    fitted = descend(posterior, vector, graduate=False, steps=0)
    return Model(posterior, fitted, judge(posterior, fitted))


@pytest.fixture(scope="module")
def elsewhere(two):
    """Rounds with a load at half its size and, beside it, the lag that is there; and their bench, which refits a load
    beside the lag."""
    bench = Bench(*two, ["load"])
    half = effect("ConstantLoad", load=0.5 * float(LOAD.load))
    first = bench.a_round(two[0], _resting(bench, two[0], half), "load")
    second = bench.a_round(bench.model(first), _resting(bench, bench.model(first), LAG), "lag")
    return [first, second], bench


def test_an_effect_makes_way_for_itself_at_a_better_minimum(elsewhere):
    chain, bench = elsewhere
    found = bench.search.swap(list(chain))
    assert [one.row.effect for one in found] == ["drive_lag", "constant_load"]
    load = bench.model(found[1]).judgement.drive.effects[-1].load
    assert float(load) == pytest.approx(float(LOAD.load), rel=0.02)
    # Once it is there, it stays.
    again = bench.chain("lag", "load")
    assert [one.reference for one in bench.search.swap(again)] == [one.reference for one in again]


def test_what_is_refused_may_show_a_better_minimum_of_what_is_named(elsewhere):
    """The lag goes again: that of all it should explain is asked beside the better minimum."""
    (first, second), bench = elsewhere
    found = bench.search.instead([first], dropping(second, "explains too little"))
    assert [one.row.effect for one in found] == ["constant_load"]
    assert bench.model(found[0]).fitted.misfit < bench.model(first).fitted.misfit


def _asking_for_more(search):
    return dataclasses.replace(search, rule=Rule().changed({"accept.enough_share": 2.0}))


class _DropsOne(Search):
    """A search to which one of several effects is never needed."""

    def drop(self, chain):
        return chain[:1]


@pytest.mark.parametrize(
    "change",
    [_asking_for_more, lambda search: _DropsOne(search.tables, search.rule, search.most)],
    ids=["all but nearly all", "one is not needed"],
)
def test_a_name_comes_in_only_with_nearly_all_explained_and_both_needed(two, change):
    """The same rounds as above, with a share that cannot be had, or with a review that drops one."""
    assert _instead(two, "pendulum", "lag", ["load"], change)[0] is None
