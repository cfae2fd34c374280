"""The search without derivatives: what it keeps, that it only gets better, and that it finds a gap."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, experiment
from helpers_plants import effect

from frictionjax.diagnosis import refit
from frictionjax.diagnosis.floor import scatter
from frictionjax.diagnosis.judge import judge
from frictionjax.diagnosis.name import forms_to_try, try_form
from frictionjax.diagnosis.present import present_model
from frictionjax.diagnosis.refit import Model
from frictionjax.diagnosis.search import coupled_starts, searched, wide_knees
from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.joint import FAST_BANDWIDTH, SLOW_BANDWIDTH, extend, make_joint
from frictionjax.estimation.robust_fit import descend
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import catalogue

DEFLECTION = float(PLANT.friction.Fs / PLANT.friction.sigma0)
TRUE = {"ratio": 0.3, "gap": 2.0 * DEFLECTION, "frequency": 150.0, "damping": 0.3}
DRAG = 0.5 * float(PLANT.friction.sigma2 / PLANT.J)
"""Viscous friction of the load over its inertia, 1/s: half of what the rigid machine has."""


@pytest.fixture(scope="module")
def behind_a_gap():
    """A rigid model before recordings of a machine with a gap, and that model with a second inertia."""
    own = DRAG * TRUE["ratio"] * PLANT.J
    machine = eqx.tree_at(lambda drive: drive.friction.sigma2, PLANT, PLANT.friction.sigma2 - own)
    machine = machine.with_effects(effect("Backlash", drag=DRAG, **TRUE))
    batch = make_batch(experiment(drive=machine), encoder_step=FINE)
    joint, vector = make_joint(PLANT, batch, np.zeros(4, bool))
    scales = plant_scales(PLANT, batch)
    return joint, vector, *extend(joint, vector, effect("Backlash"), scales)


def _viscous(drive):
    side = drive.load_side
    return float(drive.friction.sigma2) + float(side.drag * side.ratio * drive.J)


def test_starts_keep_the_viscous_friction_of_the_whole(behind_a_gap):
    joint, vector = behind_a_gap[2:]
    starts = coupled_starts(joint, vector, DEFLECTION)
    sides = [joint.drive(start).load_side for start in starts]
    assert len({(float(side.ratio), float(side.half_gap), float(side.stiffness)) for side in sides}) == 20
    gaps = [2.0 * float(side.half_gap) / DEFLECTION for side in sides]
    assert (min(gaps), max(gaps)) == pytest.approx((0.3, 30.0))
    for start in starts:
        assert _viscous(joint.drive(start)) == pytest.approx(float(PLANT.friction.sigma2))


def _at(joint, vector, numbers):
    """`vector` with these numbers of the coupling."""
    for index, free in enumerate(joint.layout):
        if free.parameter.name in numbers and free.path.startswith("effects."):
            value = numbers[free.parameter.name]
            vector = vector.at[index].set(np.log(value) if free.parameter.transform == "log" else value)
        elif free.path == "friction.sigma2":
            vector = vector.at[index].add(np.log(1.0 - 0.5 * TRUE["ratio"]))
    return vector


def test_a_search_finds_what_predicts_as_well_as_the_truth(behind_a_gap):
    """When the load touches is chaotic, and nobody sees it: the truth itself leaves much of the misfit."""
    rigid, start, joint, vector = behind_a_gap
    starts = coupled_starts(joint, vector, DEFLECTION)
    alone, truth = rigid.misfits([start])[0], joint.misfits([_at(joint, vector, TRUE | {"drag": DRAG})])[0]
    knees = wide_knees(joint, vector)
    assert all(a >= b for a, b in itertools.pairwise(knees)) and knees[0] > 10.0 and knees[-1] == 1.0
    found = searched(joint, starts, rounds=15, width=0.5, knees=knees)
    assert joint.misfits([found])[0] < truth < 0.7 * alone
    # As many draws at the noise alone end higher.
    assert joint.misfits([found])[0] < joint.misfits([searched(joint, starts, rounds=60, width=0.5)])[0]
    np.testing.assert_array_equal(found, searched(joint, starts, rounds=15, width=0.5, knees=knees))
    side = joint.drive(found).load_side
    assert float(side.ratio) == pytest.approx(TRUE["ratio"], rel=0.1)
    assert 0.4 < 2.0 * float(side.half_gap) / TRUE["gap"] < 2.5


def test_a_search_is_given_up_where_no_gap_helps(behind_a_gap):
    """A load that only pushes is no gap; and what a gap leaves is not given up."""
    _, _, joint, vector = behind_a_gap
    options = {"rounds": 6, "width": 0.5, "rigid": vector}
    starts = coupled_starts(joint, vector, DEFLECTION)
    assert searched(joint, starts, knees=wide_knees(joint, vector), **options) is not None
    pushed = PLANT.with_effects(effect("ConstantLoad", load=0.1 * float(PLANT.friction.Fc)))
    batch = make_batch(experiment(drive=pushed), encoder_step=FINE)
    other, begin = make_joint(PLANT, batch, np.zeros(4, bool))
    fitted = descend(other, begin)
    assert fitted.misfit > 0.1
    other, vector = extend(other, fitted.vector, effect("Backlash"), plant_scales(PLANT, batch))
    options["rigid"] = vector
    starts = coupled_starts(other, vector, DEFLECTION)
    assert searched(other, starts, knees=wide_knees(other, vector), **options) is None


def test_runs_with_a_gap_part_by_more_than_the_force_that_sets_them_apart(behind_a_gap):
    """By the median block, where the force shows: a rigid machine answers to it linearly."""
    rigid, start, joint, vector = behind_a_gap
    plain = scatter(rigid, start, 1e-3)
    behind = scatter(joint, _at(joint, vector, TRUE | {"drag": DRAG}), 1e-3)
    seen = plain > 0.1 * plain.max()
    assert np.median(behind[seen] / plain[seen]) > 3.0


def test_only_the_numbers_of_the_coupling_are_drawn(behind_a_gap):
    joint, vector = behind_a_gap[2:]
    (start,) = coupled_starts(joint, vector, DEFLECTION)[:1]
    found = searched(joint, [start], rounds=3, width=0.5)
    moved = {free.path for free, a, b in zip(joint.layout, found, start, strict=False) if a != b}
    own = {free.path for free in joint.layout if free.path.startswith("effects.")}
    assert moved <= own | {"friction.sigma2"}
    assert jnp.array_equal(found[len(joint.layout) :], start[len(joint.layout) :])


def test_a_refit_of_a_gap_searches_too_and_takes_the_steps_that_contacts_need(behind_a_gap, monkeypatch):
    """Once from a grid of its numbers, once with the slow observer, and once more for what may be named."""
    rigid, start, *_ = behind_a_gap
    slow = rigid.at_bandwidth(SLOW_BANDWIDTH)
    fitted = descend(slow, start, graduate=False)
    model = Model(slow, fitted, judge(slow, fitted))
    scales = plant_scales(model.judgement.drive, slow.batch)
    form = catalogue()["backlash"][0]
    present = present_model(slow.at_bandwidth(FAST_BANDWIDTH), fitted.vector)
    trial = max(try_form(present, forms_to_try(form, scales, {}), scales), key=lambda t: t.linear_gain)
    begun = []

    def watched(joint, starts, **options):
        begun.append((len(starts), joint.batch.substeps))
        return searched(joint, starts, **options)

    monkeypatch.setattr(refit, "searched", watched)
    with ThreadPoolExecutor(1) as executor:
        (found,) = refit.refit_all([trial], model, scales, executor)
    found = refit.polish(found)
    steps = found.model.joint.batch.substeps
    assert steps > 1
    assert begun == [(40, 1), (1, steps), (1, steps)]
    assert found.model.fitted.misfit < 0.6 * fitted.misfit
    side = found.model.judgement.drive.load_side
    assert side is not None and float(side.ratio) == pytest.approx(TRUE["ratio"], rel=0.1)
