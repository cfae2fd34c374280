"""Derivatives that mean nothing are left out of what a descent sees."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop, stick_noise

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective.robust import robust_posterior


@pytest.mark.parametrize("column", [0, -1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200, 1e100])
def test_a_block_whose_derivatives_overflow_says_nothing_and_the_others_all(value, column):
    """By a parameter or by a starting deflection; in a held-out recording, too, where it is multiplied by 0. What a
    starting deflection might do is far more than a machine in stick moves: that it can be squared is enough."""
    runs = tuple(open_loop(f"stick {k}", stick_noise(), seed=k) for k in (1, 2))
    posterior, vector = robust_posterior(PLANT, make_batch(runs, encoder_step=FINE), np.array([False, True]))
    (plain,), block = posterior.evaluated(vector), posterior.batch.block
    columns = jnp.asarray(plain.columns).at[column, 1, 5 * block : 7 * block].set(value)
    spoilt = eqx.tree_at(lambda e: e.columns, plain, columns)
    sound = posterior.sound_blocks(0, columns)
    found = eqx.tree_at(lambda e: e.sound, spoilt, sound).sound_columns()
    kept = column == -1 and np.abs(value) == 1e100
    whole = np.array(columns if kept else plain.columns)
    if not kept:
        whole[:, 1, 5 * block : 7 * block] = 0.0
    np.testing.assert_array_equal(found, whole)
    assert kept or bool(jnp.all(jnp.isfinite(found)))
