"""Why a descent ended: at rest, out of steps, or where the cost is rough."""

from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.estimation.descent.robust import _STEPPER, Ending, _place
from frictionjax.estimation.objective.loss import Cauchy
from frictionjax.estimation.objective.quadratic import Quadratic


class _Rough:
    """Stands for a `Posterior` of one coordinate whose cost no step lowers, and whose `slope` promises what it says."""

    layout, parameters = (), 0
    fitted, weights = (np.ones(1),), (np.ones(1),)
    loss = Cauchy()

    def __init__(self, slope):
        self.slope = slope
        self.batch = SimpleNamespace(block_count=np.full((1, 1), 100.0))

    def evaluated(self, vector):
        return ()

    def assembled(self, evaluations, vector):
        cost = 100.0 + float(jnp.abs(vector[0]))
        return Quadratic(jnp.asarray(cost), jnp.asarray([self.slope]), jnp.eye(1))


@pytest.mark.untyped
@pytest.mark.parametrize(("slope", "ending"), [(1e-4, Ending.AT_REST), (10.0, Ending.NO_STEP)])
def test_running_out_of_damping_is_rest_only_at_a_minimum(slope, ending):
    posterior = _Rough(slope)
    place, found, tried = _STEPPER.descend(_place(posterior, jnp.zeros(1), (), 2e-3), 50)
    assert found is ending
    assert tried < 50
    np.testing.assert_array_equal(place.vector, np.zeros(1))
