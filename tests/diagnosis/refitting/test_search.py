"""The search for a load behind a gap: what tells of one, what it finds, and when it is given up."""

from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, experiment
from helpers_plants import effect

from frictionjax.diagnosis.evidence.judgement import judge
from frictionjax.diagnosis.evidence.model import Model
from frictionjax.diagnosis.evidence.noise_floor import scatter
from frictionjax.diagnosis.refitting.backlash_search import load_ratio, search_backlash, without_chaos
from frictionjax.diagnosis.refitting.refit import Hints, refit_all
from frictionjax.diagnosis.refitting.refitted import polish
from frictionjax.diagnosis.screening.linearised import present_model
from frictionjax.diagnosis.screening.score_test import forms_to_try, try_form
from frictionjax.estimation import starting_values
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH, SLOW_BANDWIDTH, extend, robust_posterior
from frictionjax.estimation.scales import plant_scales
from frictionjax.physics.effects import catalogue

DEFLECTION = float(PLANT.friction.Fs / PLANT.friction.sigma0)
TRUE = {"ratio": 0.3, "gap": 2.0 * DEFLECTION, "frequency": 150.0, "damping": 0.3}
CHAOS = 0.25
"""Of the ratio. Contacts are chaotic: where a search or a refit ends, somewhat light, changes with the rounding, as
does what the truth itself leaves."""
DRAG = 0.5 * float(PLANT.friction.sigma2 / PLANT.J)
"""Viscous friction of the load over its inertia, 1/s: half of what the rigid machine has."""


@pytest.fixture(scope="module")
def recordings():
    """Of a machine with a gap."""
    own = DRAG * TRUE["ratio"] * PLANT.J
    machine = eqx.tree_at(lambda drive: drive.friction.sigma2, PLANT, PLANT.friction.sigma2 - own)
    return experiment(drive=machine.with_effects(effect("Backlash", drag=DRAG, **TRUE)))


@pytest.fixture(scope="module")
def behind_a_gap(recordings):
    """A rigid model before these recordings, and that model with a second inertia, both with the slow observer."""
    batch = make_batch(recordings, encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.zeros(4, bool))
    posterior, scales = posterior.at_bandwidth(SLOW_BANDWIDTH), plant_scales(PLANT, batch)
    return posterior, vector, *extend(posterior, vector, effect("Backlash"), scales)


def _at(posterior, vector, numbers):
    """`vector` with these numbers of the coupling, and the viscous friction that is left to the motor."""
    for index, free in enumerate(posterior.layout):
        if free.parameter.name in numbers and free.path.startswith("effects."):
            value = numbers[free.parameter.name]
            vector = (
                jnp.asarray(vector)
                .at[index]
                .set(np.log(value) if free.parameter.transform == "log" else value)
            )
        elif free.path == "friction.sigma2":
            vector = jnp.asarray(vector).at[index].add(np.log(1.0 - 0.5 * TRUE["ratio"]))
    return vector


def test_noise_in_stick_shows_the_inertia_of_the_motor_alone(recordings):
    start = starting_values(recordings, motor_constant=float(PLANT.motor_constant))
    assert start.stick_inertia == pytest.approx(0.7 * float(PLANT.J), rel=0.05)
    assert float(start.drives[0].J) == pytest.approx(float(PLANT.J), rel=0.05)
    sliding_only = starting_values(recordings[3:], motor_constant=float(PLANT.motor_constant))
    assert sliding_only.stick_inertia is None


def test_what_stick_lacks_of_the_inertia_is_the_load(behind_a_gap):
    posterior, vector = behind_a_gap[:2]
    inertia = float(PLANT.J)
    assert load_ratio(posterior, vector, 0.7 * inertia) == pytest.approx(0.3)
    assert load_ratio(posterior, vector, None) is None
    assert load_ratio(posterior, vector, 0.98 * inertia) is None
    assert load_ratio(posterior, vector, 0.05 * inertia) is None
    # A fit that ended as light as the machine is in stick tells, too.
    light = jnp.asarray(vector).at[0].add(np.log(0.6))
    assert posterior.layout[0].path == "J"
    assert load_ratio(posterior, light, None) == pytest.approx(0.4)


def test_no_fit_sees_what_is_chaotic(behind_a_gap):
    rigid, start, posterior, vector = behind_a_gap
    true = _at(posterior, vector, TRUE | {"drag": DRAG})
    kept = without_chaos(posterior, true)
    blocks = np.asarray(kept.weights[0]).reshape(posterior.batch.block_count.shape)
    scored = np.asarray(posterior.batch.block_count) > 0
    left = [np.mean(row[own]) for row, own in zip(blocks, scored, strict=True)]
    assert left[2] < 0.5 < min(left[0], left[3])  # loud noise; quiet noise, moves
    # Everything is judged as before, and what was left out moves nothing.
    np.testing.assert_array_equal(kept.powers([true])[0], posterior.powers([true])[0])
    before, after = kept.near(true), posterior.near(true)
    count, power = np.asarray(posterior.batch.block_count), np.asarray(after.powers[0])
    lost = np.sum(count * posterior.loss.cost(power) / 2.0, where=blocks == 0.0)
    assert lost > 0.0 and float(before.cost) == pytest.approx(float(after.cost) - lost)
    # A rigid machine answers to the force by less than its noise everywhere.
    whole = without_chaos(rigid, start)
    np.testing.assert_array_equal(whole.weights[0], rigid.weights[0])


@pytest.mark.parametrize(
    "nudge", [0.0, *(pytest.param(k * 1e-10, marks=pytest.mark.slow) for k in (1, 2, 3, 4))]
)
def test_a_search_finds_the_gap_and_the_load_s_own_friction(behind_a_gap, nudge):
    """From starts that differ by rounding alone, too."""
    posterior, vector = behind_a_gap[2:]
    found = search_backlash(posterior, vector + nudge, DEFLECTION, TRUE["ratio"])
    assert found is not None
    side = posterior.drive_of(found).load_side
    assert side is not None
    assert float(side.ratio) == pytest.approx(TRUE["ratio"], rel=CHAOS)
    assert 2.0 * float(side.half_gap) == pytest.approx(TRUE["gap"], rel=0.3)
    assert float(side.drag) == pytest.approx(DRAG, rel=0.3)
    # In all blocks even the truth leaves half: what is chaotic. Where it is not, most of the cost is the missing gap.
    kept = without_chaos(posterior, _at(posterior, vector, TRUE | {"drag": DRAG})).weights[0]
    rigid = _at(posterior, vector, {"ratio": 1e-6})
    with_gap, without = (losses_of(power, posterior.batch) for power in posterior.powers([found, rigid]))
    kept = np.asarray(kept).reshape(without.shape)
    assert np.sum(kept * with_gap) < 0.4 * np.sum(kept * without)


@pytest.mark.parametrize(
    "nudge", [0.0, *(pytest.param(k * 1e-10, marks=pytest.mark.slow) for k in (1, 2, 3, 4))]
)
def test_a_search_without_a_ratio_tries_some(behind_a_gap, nudge):
    posterior, vector = behind_a_gap[2:]
    found = search_backlash(posterior, vector + nudge, DEFLECTION, None)
    assert found is not None
    side = posterior.drive_of(found).load_side
    assert side is not None and float(side.ratio) == pytest.approx(TRUE["ratio"], rel=CHAOS)


def test_a_search_is_given_up_where_no_gap_helps(behind_a_gap):
    """A load that only pushes is no gap; and without sliding nothing tells of one."""
    posterior, vector = behind_a_gap[2:]
    stick = eqx.tree_at(lambda j: j.fitted, posterior, (jnp.array([1.0, 0.0, 0.0, 0.0]),))
    assert search_backlash(stick, vector, DEFLECTION, 0.3) is None
    pushed = PLANT.with_effects(effect("ConstantLoad", load=0.1 * float(PLANT.friction.Fc)))
    batch = make_batch(experiment(drive=pushed), encoder_step=FINE)
    other, begin = robust_posterior(PLANT, batch, np.zeros(4, bool))
    fitted = descend(other, begin)
    assert fitted.misfit > 0.1
    other, vector = extend(other, fitted.vector, effect("Backlash"), plant_scales(PLANT, batch))
    assert search_backlash(other, vector, DEFLECTION, 0.3) is None


def test_runs_with_a_gap_part_by_more_than_the_force_that_sets_them_apart(behind_a_gap):
    """By the median block, where the force shows: a rigid machine answers to it linearly."""
    rigid, start, posterior, vector = behind_a_gap
    plain = scatter(rigid, start, 1e-3)
    behind = scatter(posterior, _at(posterior, vector, TRUE | {"drag": DRAG}), 1e-3)
    seen = plain > 0.1 * plain.max()
    assert np.median(behind[seen] / plain[seen]) > 3.0


@pytest.mark.slow
@pytest.mark.parametrize("tested", [True, False])
def test_a_refit_of_a_gap_begins_where_the_search_ends(behind_a_gap, tested):
    """Whether its test is on the short list, or the inertia in stick alone tells of it."""
    rigid, start, *_ = behind_a_gap
    fitted = descend(rigid, start, graduate=False)
    model = Model(rigid, fitted, judge(rigid, fitted))
    scales = plant_scales(model.judgement.drive, rigid.batch)
    present = present_model(rigid.at_bandwidth(FAST_BANDWIDTH), fitted.vector)

    def best(name):
        form = catalogue()[name][0]
        trials = try_form(present, forms_to_try(form, scales, {}), scales)
        return max(trials, key=lambda trial: trial.linear_gain)

    gap, other = best("backlash"), best("quadratic_drag")
    with ThreadPoolExecutor(1) as executor:
        refits = refit_all(
            [gap] if tested else [other],
            model,
            scales,
            executor,
            Hints(gaps=[gap], stick_inertia=0.7 * float(PLANT.J)),
        )
        without = refit_all([other], model, scales, executor, Hints(gaps=[gap]))
    found = next(polish(r) for r in refits if r.effect == "backlash")
    # Where stick does not show it, it is searched only if the fit itself ended at another inertia than it began with.
    alone = load_ratio(rigid, fitted.vector, None) is not None
    assert any(r.effect == "backlash" for r in without) == alone
    # Of all blocks chaos leaves more than half, with or without a search. In those that the fit sees the gap tells.
    kept, end = found.model.posterior, found.model.fitted
    assert end.near.cost < 0.4 * kept.near(_at(kept, end.vector, {"ratio": 1e-6})).cost
    assert np.any(np.asarray(found.model.posterior.weights[0]) < 1.0)
    side = found.model.judgement.drive.load_side
    assert side is not None and float(side.ratio) == pytest.approx(TRUE["ratio"], rel=CHAOS)
