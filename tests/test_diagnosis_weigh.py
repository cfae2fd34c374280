"""What a chaotic machine is excused for: by no more than half, and nowhere below what the model without it leaves."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, break_away, open_loop, stick_noise

from frictionjax.diagnosis.judge import Judgement
from frictionjax.diagnosis.weigh import _excused
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
