"""Why a descent ended: at rest, out of steps, or where the cost is rough."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.estimation.descent.robust import Ending, _walk
from frictionjax.estimation.objective.look import Look


class _Rough:
    """Stands for a `Joint` of one coordinate whose cost no step lowers, and whose `slope` promises what it says."""

    layout = ()
    fitted = np.ones(1)

    def __init__(self, slope):
        self.slope = slope
        self.batch = SimpleNamespace(block_count=np.full((1, 1), 100.0))

    def seen(self, vector):
        return None

    def look_of(self, seen, vector, knee):
        cost = 1.0 + float(jnp.abs(vector[0]))
        own = jnp.asarray([self.slope])
        return Look(jnp.ones((1, 1)), jnp.asarray(cost), own, jnp.eye(1), jnp.zeros((1, 1)))


@pytest.mark.parametrize(("slope", "ending"), [(1e-4, Ending.AT_REST), (10.0, Ending.NO_STEP)])
def test_running_out_of_damping_is_rest_only_at_a_minimum(slope, ending):
    joint = _Rough(slope)
    assert _walk(joint, jnp.zeros(1), None, 1.0, 50, 2e-3)[-1] is ending
