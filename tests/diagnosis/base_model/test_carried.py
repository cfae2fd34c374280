"""A machine whose motor force goes into gravity: no base model predicts it, and the force balance says what does."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from helpers_arm import ARM, SINE, swings

from frictionjax.core import silent
from frictionjax.diagnosis.base_model.carried import carried
from frictionjax.diagnosis.base_model.credibility import credibility, made_credible
from frictionjax.diagnosis.base_model.fit_base import base_of
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.findings.candidates import candidates
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.acceptance import acceptable
from frictionjax.diagnosis.selection.refit_candidates import CandidateRefitter
from frictionjax.diagnosis.table import Lead, ModelComparison
from frictionjax.estimation.start.force_balance import force_balance
from frictionjax.recordings import Case, Plant

RULE = Rule()


@pytest.fixture(scope="module")
def executor():
    with ThreadPoolExecutor(2) as threads:
        yield threads


@pytest.fixture(scope="module")
def starting():
    return starting_point(Case("arm", Plant(1.0, "rad", "N*m", "N*m"), swings(seconds=5.0)))


@pytest.fixture(scope="module")
def forces(starting):
    fitted = tuple(r for r in starting.recordings if r.role == "fit")
    return force_balance(fitted, starting.start.drives)


@pytest.fixture(scope="module")
def found(starting, forces, executor):
    return carried(starting, forces, executor, silent, rule=RULE)


def test_the_base_model_alone_is_not_credible(starting, executor):
    assert not credibility(base_of(starting, executor, silent)).is_credible()


def test_gravity_comes_first_with_the_size_inertia_and_friction_that_were_fitted(found):
    first = found.forces[0]
    assert first.effect.name == "gravity_pendulum"
    assert float(first.effect.sine) == pytest.approx(SINE, rel=0.002)
    assert float(first.drives[0].J) == pytest.approx(float(ARM.J), rel=0.01)
    assert float(first.drives[0].friction.Fc) == pytest.approx(float(ARM.friction.Fc), rel=0.05)
    assert not first.drives[0].effects


@pytest.mark.slow
def test_the_first_round_asks_for_these_forces_and_accepts_the_right_one(found, executor):
    base = found.base
    rule, effort = RULE, Effort()
    candidates = CandidateRefitter(
        executor,
        silent,
        2.0 * np.pi,
        None,
        frozenset(),
        frozenset(),
        None,
        lambda: found.forces,
        rule,
        effort,
    )
    _, trials, refits = dataclasses.replace(candidates, carried=True).beside(base, 0)
    assert {trial.effect for trial in trials} >= {one.effect.name for one in found.forces}
    best = refits[0]
    assert best.effect == "gravity_pendulum"
    assert made_credible(base, [best.model], rule) == (True,)
    assert float(best.model.judgement.drive.effects[0].sine) == pytest.approx(SINE, rel=0.002)


def test_a_reversed_input_is_not_carried_by_any_force(starting, executor):
    """No force of the catalogue makes up for it: the sign is checked instead."""
    turned = tuple(dataclasses.replace(r, u=-r.u) for r in starting.recordings)
    other = starting_point(Case("arm", Plant(1.0, "rad", "N*m", "N*m"), turned))
    fitted = tuple(r for r in other.recordings if r.role == "fit")
    forces = force_balance(fitted, other.start.drives)
    assert carried(other, forces, executor, silent, rule=RULE) is None


def row(**own):
    plain = ModelComparison(
        before=(),
        after=("GravityPendulum",),
        effect="gravity_pendulum",
        form="GravityPendulum",
        exact=(True,),
        misfits_before=(2.0, 2.0),
        misfits_after=(1.5, 1.5),
        misfit_errors=(0.001, 0.001),
        energies=(0.7, 0.7),
        fit=Lead(100.0, 10.0, 50),
        held_out=Lead(50.0, 10.0, 20),
    )
    return dataclasses.replace(plain, **own)


def test_what_makes_a_model_of_none_is_accepted_whatever_share_it_explains():
    least = RULE.accept.least_share
    assert not acceptable(row(), RULE, least_share=least)[0]
    assert acceptable(row(makes_credible=True), RULE, least_share=least)[0]
    # Chance is none the less refused.
    assert not acceptable(row(makes_credible=True, held_out=Lead(1.0, 10.0, 20)), RULE)[0]
    assert np.isclose(row().gains(RULE).share, 0.25)


@pytest.mark.untyped
def test_what_was_not_tested_after_it_says_why():
    first = SimpleNamespace(
        trials=[], refits=[], compared=[row(makes_credible=True)], accepted=None, dropped=""
    )
    reasons = {one.effect: one.reason for one in candidates([first], {}, {"delay": "too slow"})}
    assert reasons["ripple"].startswith("not tested: without the force that carries the machine")
    assert reasons["delay"] == "too slow"
