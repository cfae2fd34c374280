"""What a chaotic machine is excused for: by no more than half, and nowhere below what the model without it leaves."""

from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, break_away, open_loop, stick_noise
from helpers_plants import effect

from frictionjax.diagnosis.evidence.judgement import Judgement, explained
from frictionjax.diagnosis.selection.decide import _above, _excused, _explained_where_told
from frictionjax.diagnosis.selection.select import _leaves_chaos
from frictionjax.diagnosis.selection.verdict_rule import most_left
from frictionjax.estimation.data.batch import make_batch


@pytest.fixture(scope="module")
def judged():
    """A model that errs much in half of the blocks of two recordings, one of them kept aside."""
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
    raised = _excused(judged, floor, np.full(judged.power.shape, min(left, 1e6)))
    whole, rest = np.array(judged.misfits(floor)), np.array(judged.misfits(raised))
    assert np.all(rest >= 0.5 * whole)
    assert np.all(rest < whole)


def test_what_a_chaotic_machine_leaves_itself_is_the_floor_where_less_was_explained_before(judged):
    raised = _excused(judged, np.ones((2, 1)), np.full(judged.power.shape, 3.0))
    np.testing.assert_array_equal(raised, np.where(judged.power > 3.0, 3.0, 1.0))


def test_nothing_is_excused_where_nothing_is_left(judged):
    floor = np.full((2, 1), 2.0)
    np.testing.assert_array_equal(
        _excused(judged, floor, np.zeros(judged.power.shape)), floor * np.ones(judged.power.shape)
    )


def test_what_a_chaotic_machine_explains_is_seen_where_its_fit_saw_anything(judged):
    """It mends the loud blocks that its fit saw, and is far off in the others, which are chaotic."""
    batch, blocks = judged.batch, np.arange(judged.power.shape[1])
    seen = np.broadcast_to(blocks < blocks.size // 2, judged.power.shape)
    weight = batch.valid * jnp.repeat(jnp.asarray(1.0 * seen), batch.block, axis=1)
    joint = SimpleNamespace(batch=batch, setting=SimpleNamespace(weight=weight))
    mended = eqx.tree_at(lambda j: j.power, judged, np.where(seen, 1.0, 1e4))
    rigid, chaotic = SimpleNamespace(judgement=judged), SimpleNamespace(judgement=mended, joint=joint)
    floor = np.ones((2, 1))
    assert min(explained(judged, mended, floor)) < 0.0
    assert _explained_where_told(rigid, chaotic, floor) == pytest.approx((1.0, 1.0))


def _with(judged, *effects, power=None):
    drive = judged.drive.with_effects(*effects)
    own = judged.power if power is None else power
    return SimpleNamespace(judgement=eqx.tree_at(lambda j: (j.drive, j.power), judged, (drive, own)))


@pytest.mark.parametrize("leader_stays", [True, False])
def test_a_floor_is_raised_only_if_the_same_candidate_leads_above_it(judged, leader_stays):
    """The gap mends the early blocks, which are more; another the late ones, which are all that is left above the floor
    that excuses the early ones."""
    count = np.sum(np.asarray(judged.batch.block_count) > 0.0, axis=1, keepdims=True)
    early = np.arange(judged.power.shape[1]) < 0.6 * count
    quiet = np.ones_like(judged.power)
    gap = _with(
        judged, effect("Backlash"), power=quiet if leader_stays else np.where(early, 1.0, judged.power)
    )
    other = _with(judged, effect("Creep"), power=np.where(early, judged.power, 1.0))
    refits = [SimpleNamespace(model=other), SimpleNamespace(model=gap)]
    floor, raised = quiet, np.where(early, 300.0, 1.0)
    found, compared, ranked = _above(_with(judged), refits, floor, raised)
    assert ranked[0].model is gap
    assert found is (raised if leader_stays else floor)
    assert compared[id(ranked[0])].worth >= compared[id(ranked[1])].worth


def test_beside_a_gap_a_raised_floor_stays(judged):
    """A chaotic machine's floor is that of the round before."""
    refits = [SimpleNamespace(model=_with(judged, power=np.ones_like(judged.power)))]
    raised = np.full((2, 1), 5.0)
    assert _above(_with(judged, effect("Backlash")), refits, np.ones((2, 1)), raised)[0] is raised


@pytest.mark.parametrize("name", ["Backlash", "FlexibleTransmission"])
def test_rounds_end_beside_a_gap_that_explains_enough(judged, name):
    """What a gap leaves is chaos; what a spring leaves may be something else."""
    model = _with(judged, effect(name))
    limit = most_left(model.judgement.drive.effects)
    enough, short = 1.0 - 0.9 * limit, 1.0 - 1.1 * limit
    assert _leaves_chaos(model, (enough, enough)) == (name == "Backlash")
    assert not _leaves_chaos(model, (enough, short))
