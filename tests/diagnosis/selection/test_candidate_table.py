"""What a chaotic machine is excused for: by no more than half, and nowhere below what the model without it leaves."""

from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, break_away, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.evidence.judgement import Judgement, explained
from frictionjax.diagnosis.evidence.noise_floor import Answer
from frictionjax.diagnosis.selection.candidate_table import (
    excused_floor,
    explained_where_predictable,
    ground_of,
    keeps_the_best,
    not_above_what_is_left,
)
from frictionjax.estimation.data.batch import make_batch


@pytest.fixture(scope="module")
def judged():
    """A model that is much in error in half of the blocks of two recordings, one of them held out."""
    recordings = (
        open_loop("stick", stick_noise(4.0, seed=0), seed=1),
        open_loop("ramps", break_away(), seed=2),
    )
    batch = make_batch(recordings, encoder_step=FINE)
    power = np.where(np.arange(batch.block_count.shape[1]) % 2 == 0, 300.0, 1.0) * np.ones((2, 1))
    return Judgement(PLANT, jnp.zeros(2), power, np.array([False, True]), batch)


@pytest.mark.parametrize("left", [3.0, 30.0, 1e4, np.inf])
def test_no_more_than_half_is_excused(judged, left):
    floor = np.ones((2, 1))
    raised = excused_floor(judged, floor, np.full(judged.power.shape, min(left, 1e6)))
    whole, rest = np.array(judged.misfits(floor)), np.array(judged.misfits(raised))
    assert np.all(rest >= 0.5 * whole)
    assert np.all(rest < whole)


def test_what_a_chaotic_machine_leaves_itself_is_the_floor_where_less_was_explained_before(judged):
    raised = excused_floor(judged, np.ones((2, 1)), np.full(judged.power.shape, 3.0))
    np.testing.assert_array_equal(raised, np.where(judged.power > 3.0, 3.0, 1.0))


def test_nothing_is_excused_where_nothing_is_left(judged):
    floor = np.full((2, 1), 2.0)
    np.testing.assert_array_equal(
        excused_floor(judged, floor, np.zeros(judged.power.shape)), floor * np.ones(judged.power.shape)
    )


@pytest.mark.untyped
def test_what_a_chaotic_machine_explains_is_seen_where_its_fit_saw_anything(judged):
    """It corrects the loud blocks that its fit saw, and is far off in the others, which are chaotic."""
    batch, blocks = judged.batch, np.arange(judged.power.shape[1])
    seen = np.broadcast_to(blocks < blocks.size // 2, judged.power.shape)
    posterior = SimpleNamespace(batch=batch, weights=(jnp.asarray(1.0 * seen).ravel(),))
    corrected = eqx.tree_at(lambda j: j.power, judged, np.where(seen, 1.0, 1e4))
    rigid, chaotic = (
        SimpleNamespace(judgement=judged),
        SimpleNamespace(judgement=corrected, posterior=posterior),
    )
    floor = np.ones((2, 1))
    assert min(explained(judged, corrected, floor)) < 0.0
    assert explained_where_predictable(rigid, chaotic, floor) == pytest.approx((1.0, 1.0))


def _with(judged, *effects, power=None):
    drive = judged.drive.with_effects(*effects)
    own = judged.power if power is None else power
    return SimpleNamespace(judgement=eqx.tree_at(lambda j: (j.drive, j.power), judged, (drive, own)))


@pytest.mark.untyped
@pytest.mark.parametrize("leader_stays", [True, False])
def test_a_floor_is_raised_only_if_the_same_candidate_leads_above_it(judged, leader_stays):
    """The gap corrects the early blocks, which are more; another the late ones, which are all that is left above the
    floor that excuses the early ones."""
    count = np.sum(np.asarray(judged.batch.block_count) > 0.0, axis=1, keepdims=True)
    early = np.arange(judged.power.shape[1]) < 0.6 * count
    quiet = np.ones_like(judged.power)
    gap = _with(
        judged, effect("Backlash"), power=quiet if leader_stays else np.where(early, 1.0, judged.power)
    )
    other = _with(judged, effect("Creep"), power=np.where(early, judged.power, 1.0))
    refits = [SimpleNamespace(model=other), SimpleNamespace(model=gap)]
    raised = np.where(early, 300.0, 1.0)
    assert keeps_the_best(_with(judged), refits, quiet, raised) == leader_stays


def _joint(judged):
    """As much of an objective as a floor needs, of white noise that leaves unit power."""
    return SimpleNamespace(batch=judged.batch, fitted=(jnp.array([1.0, 0.0]),))


@pytest.mark.untyped
def test_beside_a_gap_a_raised_floor_stays(judged):
    """A chaotic machine's floor is that of the round before."""
    unit = np.ones((1, *judged.power.shape))
    answer = Answer(np.zeros(judged.power.shape), unit[0], unit, 0.0 * unit, 0.0 * unit)
    model = _with(judged, effect("Backlash"))
    model.posterior = _joint(judged)
    refits = [SimpleNamespace(model=_with(judged, power=np.ones_like(judged.power)))]
    plain = ground_of(model, refits, answer).floor
    before = np.full(judged.power.shape, 5.0)
    assert np.all(plain < 5.0)
    np.testing.assert_array_equal(ground_of(model, refits, answer, before).floor, before)


@pytest.mark.parametrize("thought", [1.0, 3.0])
def test_noise_that_was_thought_larger_hides_no_better_model(judged, thought):
    """Blocks of few samples scatter, so that the misfit of a perfect model is below zero; so it is where the noise is
    smaller than it was thought to be. The likeliest model is at the floor in either case, and the other one above."""
    rng = np.random.default_rng(0)
    perfect = rng.chisquare(6, judged.power.shape) / 6 / thought
    likeliest, worse = (_with(judged, power=power).judgement for power in (perfect, 1.2 * perfect))
    unit = np.ones_like(perfect)
    assert max(likeliest.misfits(unit)) < 0.0
    floor = not_above_what_is_left(unit, [worse, likeliest])
    assert likeliest.misfits(floor) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert min(worse.misfits(floor)) > 0.03
    # A factor for the fitted and one for the held-out recordings, so that what is left in some of them still counts.
    assert np.all(floor == floor[:, :1])


def test_a_floor_is_not_lowered_to_what_misses_something(judged):
    """Nor raised: a misfit above the noise stays."""
    floor = np.ones_like(judged.power)
    np.testing.assert_array_equal(not_above_what_is_left(floor, [judged]), floor)
    held = _with(judged, power=np.where(judged.held_out[:, None], 0.5, judged.power)).judgement
    lowered = not_above_what_is_left(floor, [judged, held])
    np.testing.assert_array_equal(lowered[0], floor[0])
    assert np.all(lowered[1] < 1.0)


@pytest.mark.untyped
def test_the_ground_of_an_input_driven_table_is_what_the_likeliest_leaves(judged):
    unit = np.ones((1, *judged.power.shape))
    answer = Answer(np.zeros(judged.power.shape), unit[0], unit, 0.0 * unit, 0.0 * unit)
    model, found = (
        _with(judged, power=np.full_like(unit[0], 0.8)),
        _with(judged, power=np.full_like(unit[0], 0.6)),
    )
    for one in (model, found):
        one.posterior = _joint(judged)
    ground = ground_of(model, [SimpleNamespace(model=found)], answer)
    assert found.judgement.misfits(ground.floor) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert min(model.judgement.misfits(ground.floor)) > 0.05


def test_without_noise_the_floor_stays_a_number(judged):
    floor = np.ones_like(judged.power)
    silent = _with(judged, power=np.zeros_like(floor)).judgement
    lowered = not_above_what_is_left(floor, [silent])
    assert np.all(np.isfinite(lowered)) and np.all(lowered > 0.0)
    assert np.all(np.isfinite(judged.misfits(lowered)))
