"""The ceiling: a force that may be anything of what is known at each instant, judged on held-out recordings."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from helpers_estimation import PLANT, base_fit, closed_loop, moves
from helpers_plants import effect
from helpers_rule import row

from frictionjax.diagnosis.evidence.model import scene_of
from frictionjax.diagnosis.findings.ceiling import ceiling_of
from frictionjax.diagnosis.findings.free_force import free_force
from frictionjax.diagnosis.findings.summary import summary_sentence
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.selection.conclusion import is_above
from frictionjax.diagnosis.verdict import Ceiling, Unexplained

RULE = Rule()
NAMES = ("there", "back", "again", "others")
SINE = 0.12 * float(PLANT.friction.Fc)


def servo(drive):
    """Four closed-loop recordings of the `drive`, the last held out."""
    targets = [(0.3, -0.1, 0.02), (-0.25, 0.1, 0.28), (0.15, -0.3, 0.3), (-0.2, 0.25, -0.05)]
    return [
        closed_loop(
            name,
            moves(positions=there, durations=(0.3, 0.5, 0.4)),
            seed=number,
            drive=drive,
            role="holdout" if name == "others" else "fit",
        )
        for number, (name, there) in enumerate(zip(NAMES, targets, strict=True))
    ]


def reached(drive):
    """The base model of the servo's recordings, and the ceiling above it."""
    model = base_fit([PLANT], servo(drive))
    return model, ceiling_of(model, scene_of(model, NAMES), np.zeros(4))[0]


def test_a_force_over_position_that_the_model_lacks_is_found_with_its_size():
    """A wave along the stroke: no friction bends to it. Its size is that of a sine where the servo was."""
    model, found = reached(PLANT.with_effects(effect("Ripple", sine=SINE, period=0.21)))
    assert found is not None and found.above
    assert found.variable.startswith("position")
    assert found.share_holdout > 0.9
    x = np.asarray(model.posterior.batch.x)[np.asarray(model.posterior.batch.valid) > 0]
    true = SINE * np.sqrt(np.mean(np.sin(2.0 * np.pi * x / 0.21) ** 2))
    assert found.force == pytest.approx(true, rel=0.2)
    assert found.of_coulomb == pytest.approx(found.force / float(model.judgement.drive.friction.Fc))
    assert found.misfit_free < 0.1 * found.misfit_model
    (step,) = found.recordings
    assert step.recording == "others" and step.base == step.model > 1.2 > step.free > 0.9
    # One recording is held out: its samples alone make the misfit.
    assert step.model**2 == pytest.approx(2.0 * np.exp(2.0 * found.misfit_model) - 1.0)
    assert step.free**2 == pytest.approx(2.0 * np.exp(2.0 * found.misfit_free) - 1.0)


def test_where_nothing_is_missing_no_force_predicts_better():
    _, found = reached(PLANT)
    assert found is not None and not found.above
    assert found.of_coulomb < 0.01


def test_columns_of_each_variable_add_up_to_one_or_to_the_direction():
    model = base_fit([PLANT], servo(PLANT))
    scene, batch = scene_of(model, NAMES), model.posterior.batch
    x = np.asarray(batch.x)
    v = np.gradient(x, axis=1) / np.asarray(batch.dt)[:, None]
    inside = np.asarray(batch.valid) > 0
    groups = free_force(x, v, 0.0 * x, np.asarray(batch.u), PLANT, scene, np.arange(4.0))
    sums = {group.variable: group.columns.sum(axis=0) for group in groups}
    assert len(sums) == len(groups)
    for variable in ("velocity", "position", "input"):
        np.testing.assert_allclose(sums[variable], 1.0 * inside, atol=1e-12)
    direction = sums["position and direction"]
    assert np.max(np.abs(direction)) <= 1.0
    for variable in ("distance since a reversal", "the last rest", "size of the input and direction", "time"):
        np.testing.assert_allclose(sums[variable], direction, atol=1e-12)
    assert np.all(direction[inside & (v > 1.0)] > 0.99) and np.all(direction[inside & (v < -1.0)] < -0.99)


def test_a_velocity_has_the_same_columns_under_every_sensor():
    """A coarse sensor in one recording of two with the same motion: the force is one function of the velocity."""
    model = base_fit([PLANT], servo(PLANT))
    batch = model.posterior.batch
    noisier = np.asarray(batch.noise) * np.array([1.0, 1e4, 1.0, 1.0])
    scene = eqx.tree_at(lambda s: s.batch.noise, scene_of(model, NAMES), noisier)
    x = np.repeat(np.asarray(batch.x)[:1], 4, axis=0)
    v = np.gradient(x, axis=1) / np.asarray(batch.dt)[:, None]
    groups = free_force(x, v, 0.0 * x, np.asarray(batch.u), PLANT, scene, np.zeros(4))
    columns = next(group.columns for group in groups if group.variable == "velocity")
    both = (np.asarray(batch.valid)[:2] > 0).all(axis=0)
    np.testing.assert_array_equal(columns[:, 0, both], columns[:, 1, both])


def test_both_a_lead_and_a_drop_that_matters_are_asked():
    assert is_above(row((0.5, 0.5), leads=(9.0, 5.0)), RULE)
    assert not is_above(row((0.5, 0.5), before=(0.01, 0.01), leads=(9.0, 5.0)), RULE)
    assert not is_above(row((0.5, 0.5), leads=(9.0, 2.0)), RULE)


def test_the_sentence_says_how_large_the_force_is_and_only_where_it_is_significant():
    free = Ceiling(0.3, 0.1, 0.7, 0.6, 8.0, 0.025, 0.05, 0.02, "velocity", True)
    rest = Unexplained(True, 1.0, "sliding")
    said = summary_sentence("unknown", (), rest, "sliding", (), None, "N*m", free)
    assert "A force that is free in velocity predicts" in said
    assert "0.025 N*m rms (5 % of Coulomb friction, 2 % of the applied force)" in said
    assert "removes 60 % of the misfit" in said
    below = dataclasses.replace(free, above=False)
    assert "free in" not in summary_sentence("unknown", (), rest, "sliding", (), None, "N*m", below)
