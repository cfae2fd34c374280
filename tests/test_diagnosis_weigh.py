"""What a chaotic machine is excused for: by no more than half, and nowhere below what the model without it leaves."""

from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, break_away, open_loop, stick_noise

from frictionjax.diagnosis.judge import Judgement, explained
from frictionjax.diagnosis.weigh import _excused, _explained_where_told
from frictionjax.estimation.batch import make_batch


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
