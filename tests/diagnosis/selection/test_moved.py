"""Errors of parameters where more than noise is left: they hold what other effects would make of the parameters."""

import dataclasses

import pytest
from helpers_estimation import PLANT
from helpers_selection import LOAD, Bench, world

from frictionjax.diagnosis.base_model.fit_base import parameters_of
from frictionjax.diagnosis.selection.model_spread import moved
from frictionjax.diagnosis.table import Lead

pytestmark = pytest.mark.untyped

TRUTH = {name: float(getattr(PLANT.friction, name)) for name in ("sigma0", "sigma1", "sigma2", "Fc", "Fs")}
TRUTH |= {"J": float(PLANT.J), "load": float(LOAD.load)}


@pytest.fixture(scope="module")
def rounds():
    """The load is named, the lag refused beside it; and the lag accepted, after which only noise is left."""
    bench = Bench(*world("load", "lag"))
    return tuple(bench.tables.step(found) for found in bench.chain("load", "lag"))


@pytest.fixture(scope="module")
def before(rounds):
    """What is reported of the model with the load, by its standard errors alone."""
    return parameters_of(rounds[0].accepted.model, {}, lacking=True)


def _errors(estimates):
    return {name: (estimates[name].value - true) / estimates[name].stderr for name, true in TRUTH.items()}


def _refused(step):
    return dataclasses.replace(step, accepted=None, dropped="explains too little")


def _stated(before, *steps):
    return moved(before, steps[0].accepted.model.posterior.layout, list(steps))


def test_a_refused_effect_that_is_real_brings_the_truth_back_into_the_errors(rounds, before):
    after, said = _stated(before, rounds[0], _refused(rounds[1]))
    far = {name for name, error in _errors(before).items() if abs(error) > 4.0}
    assert len(far) >= 2
    assert max(abs(error) for error in _errors(after).values()) < 1.96
    assert "may still be too small" in said
    assert all(after[name].value == before[name].value for name in before)


def test_the_distance_adds_to_the_error_as_a_variance(rounds, before):
    after, _ = _stated(before, rounds[0], _refused(rounds[1]))
    here, there = (float(one.accepted.model.judgement.drive.J) for one in rounds)
    assert after["J"].stderr ** 2 == pytest.approx(before["J"].stderr ** 2 + (there - here) ** 2, rel=1e-9)


def test_nothing_is_said_where_only_noise_is_left(rounds, before):
    assert moved(before, rounds[1].accepted.model.posterior.layout, list(rounds)) == (before, "")


def test_nothing_is_said_where_nothing_is_named(rounds, before):
    refused = _refused(rounds[0])
    assert moved(before, rounds[0].before.posterior.layout, [refused]) == (before, "")


@pytest.mark.parametrize("chance", ["by chance", "worse on one side"])
def test_what_chance_brings_widens_nothing(rounds, before, chance):
    refused = _refused(rounds[1])
    row = refused.compared[0]
    if chance == "by chance":
        # A hundredth of the misfit, at half a standard error, with a test that says nothing.
        half = Lead(0.5, 1.0, 100)
        left = tuple(0.99 * misfit for misfit in row.misfits_before)
        row = dataclasses.replace(row, misfits_after=left, fit=half, held_out=half, p_value=0.5)
    else:
        fit, held = row.misfits_after[0], 1.01 * row.misfits_before[1]
        row = dataclasses.replace(row, misfits_after=(fit, held))
    after, said = _stated(before, rounds[0], dataclasses.replace(refused, compared=[row]))
    assert after == before
    assert said


def test_errors_stay_where_the_last_round_accepted(rounds, before):
    """Three effects may be named: after the third nobody asked what is left."""
    after, said = _stated(before, rounds[0])
    assert after == before
    assert said
