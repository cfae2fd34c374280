"""The sandwich and its clusters against linear regression."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frictionjax.estimation.uncertainty import cautious_covariance, merged, sandwich


def test_sandwich_of_independent_noise_is_the_inverse_information():
    """Linear regression with white noise: (X'X)^-1, for clusters that are many and large enough."""
    rng = np.random.default_rng(3)
    X = rng.standard_normal((20000, 3)) @ np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 2.0]])
    e = rng.standard_normal(20000)
    gradients = (X * e[:, None]).reshape(400, 50, 3).sum(1)
    found = sandwich(X.T @ X, gradients)
    # A variance from 400 clusters has a relative standard error of sqrt(2/400).
    np.testing.assert_allclose(np.diag(found), np.diag(np.linalg.inv(X.T @ X)), rtol=3.0 * np.sqrt(2.0 / 400))


def test_sandwich_sees_what_correlates_inside_a_cluster():
    """A regressor and an error that are constant over each cluster: fifty samples are worth one."""
    rng = np.random.default_rng(4)
    x, e = (np.repeat(rng.standard_normal(2000), 50) for _ in range(2))
    gradients = (x * e).reshape(2000, 50).sum(1)[:, None]
    found = sandwich(np.array([[x @ x]]), gradients)[0, 0]
    assert found == pytest.approx(50.0 / (x @ x), rel=3.0 * np.sqrt(2.0 / 2000) * 2.0)


@given(
    recordings=st.integers(1, 4),
    each=st.integers(1, 60),
    columns=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_merged_clusters_keep_the_gradient_and_the_recordings_apart(recordings, each, columns, seed):
    gradients = np.random.default_rng(seed).standard_normal((recordings, each, columns))
    found = merged(gradients.reshape(-1, columns), recordings)
    assert found.shape[0] in {recordings * -(-each // together) for together in (1, 2, 4)}
    np.testing.assert_allclose(
        found.reshape(recordings, -1, columns).sum(1), gradients.sum(1), atol=1e-9 * recordings * each
    )
    if found.shape[0] < recordings * each:
        assert found.shape[0] >= 30


def test_clusters_are_as_long_as_leaves_enough_of_them():
    """Of 0.5 s where there are few, and of 2 s where there are many; clusters with nothing in them do not count."""
    for scored, expected in ((200, 50), (100, 50), (60, 30), (50, 50)):
        gradients = np.zeros((200, 1))
        gradients[:scored] = 1.0
        found = merged(gradients, 1)
        assert np.sum(np.any(found != 0.0, axis=1)) == expected, scored


def test_errors_hold_where_clusters_are_correlated():
    """A regressor and an error that last for four clusters: the variance of 0.5 s is short by the correlation."""
    rng = np.random.default_rng(5)
    x, e = (np.repeat(rng.standard_normal(500), 4) for _ in range(2))
    gradients, hessian = (x * e)[:, None], np.array([[x @ x]])
    short, long = sandwich(hessian, gradients)[0, 0], sandwich(hessian, merged(gradients, 1))[0, 0]
    true = 4.0 / (x @ x)
    assert long == pytest.approx(true, rel=3.0 * np.sqrt(2.0 / 500) * 2.0)
    assert short < 0.5 * true


def test_no_variance_is_below_any_of_the_three():
    """Errors that last for four clusters; a coordinate whose gradient never scatters; and as many draws of plain noise,
    in which each of the two sandwiches is often the smaller one."""
    rng = np.random.default_rng(6)
    lasting = np.repeat(rng.standard_normal((500, 2)), 4, axis=0)
    lasting[:, 1] = 0.0
    found = cautious_covariance(np.diag([2000.0, 50.0]), lasting, 1)
    assert found[0, 0] == pytest.approx(sandwich(np.diag([2000.0, 50.0]), merged(lasting, 1))[0, 0])
    assert found[1, 1] == pytest.approx(1.0 / 50.0)
    short = 0
    for _ in range(50):
        gradients = rng.standard_normal((200, 1)) * np.sqrt(10.0 / 200)
        hessian = np.array([[10.0]])
        found = cautious_covariance(hessian, gradients, 1)[0, 0]
        three = sandwich(hessian, gradients)[0, 0], sandwich(hessian, merged(gradients, 1))[0, 0], 0.1
        assert found == pytest.approx(max(three))
        short += three[0] < found
    assert short > 10
