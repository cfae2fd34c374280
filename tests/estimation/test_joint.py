"""All recordings before one structure: derivatives that mean nothing are left out."""

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, open_loop, stick_noise

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.objective import look as module
from frictionjax.estimation.objective.joint import make_joint


@pytest.mark.parametrize("column", [0, -1])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200, 1e100])
def test_a_block_whose_derivatives_overflow_says_nothing_and_the_others_all(monkeypatch, value, column):
    """By a parameter or by a starting deflection; in a recording that is kept aside, too, where it is multiplied by 0.
    What a starting deflection might do is far more than a machine in stick moves: that it can be squared is enough."""
    runs = tuple(open_loop(f"stick {k}", stick_noise(), seed=k) for k in (1, 2))
    joint, vector = make_joint(PLANT, make_batch(runs, encoder_step=FINE), np.array([False, True]))
    block = joint.batch.block
    e, columns = module.compact_jacobian(joint.layout, vector, joint.setting)
    spoilt = columns.at[column, 1, 5 * block : 7 * block].set(value)
    monkeypatch.setattr(module, "compact_jacobian", lambda *_: (e, spoilt))
    seen = module.seen_at.__wrapped__(joint.layout, vector, joint.setting, joint.most)
    told = module._told(seen, block)
    kept = column == -1 and np.abs(value) == 1e100
    whole = np.array(spoilt if kept else columns)
    if not kept:
        whole[:, 1, 5 * block : 7 * block] = 0.0
    np.testing.assert_array_equal(told, whole)
    assert kept or bool(jnp.all(jnp.isfinite(told)))
