"""The jackknife over clusters against linear regression."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frictionjax.estimation.uncertainty import (
    clustered_covariance,
    jackknife,
    merged,
    standard_errors,
)


def _sandwich(hessian, gradients):
    """H^-1 (sum_c g_c g_c') H^-1 c/(c-1): what the jackknife is for many clusters alike."""
    inverse, count = np.linalg.inv(hessian), len(gradients)
    return inverse @ (gradients.T @ gradients) @ inverse * (count / (count - 1))


def test_a_jackknife_of_independent_noise_is_the_inverse_information():
    """Linear regression with white noise: (X'X)^-1, for clusters that are many and large enough."""
    rng = np.random.default_rng(3)
    X = rng.standard_normal((20000, 3)) @ np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.3], [0.0, 0.0, 2.0]])
    e = rng.standard_normal(20000)
    gradients = (X * e[:, None]).reshape(400, 50, 3).sum(1)
    own = X.reshape(400, 50, 3)
    found = jackknife(X.T @ X, gradients, np.einsum("cti,ctj->cij", own, own))
    # A variance from 400 clusters has a relative standard error of sqrt(2/400).
    np.testing.assert_allclose(np.diag(found), np.diag(np.linalg.inv(X.T @ X)), rtol=3.0 * np.sqrt(2.0 / 400))


def test_a_jackknife_sees_what_correlates_inside_a_cluster():
    """A regressor and an error that are constant over each cluster: fifty samples are worth one."""
    rng = np.random.default_rng(4)
    x, e = (np.repeat(rng.standard_normal(2000), 50) for _ in range(2))
    gradients = (x * e).reshape(2000, 50).sum(1)[:, None]
    own = (x**2).reshape(2000, 50).sum(1)[:, None, None]
    found = jackknife(np.array([[x @ x]]), gradients, own)[0, 0]
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
    assert merged(np.ones((480, 1)), 1).shape == (120, 1)  # never longer, however many there are


def test_errors_hold_where_clusters_are_correlated():
    """A regressor and an error that last for four clusters: the variance of 0.5 s is short by the correlation."""
    rng = np.random.default_rng(5)
    x, e = (np.repeat(rng.standard_normal(500), 4) for _ in range(2))
    gradients, hessian = (x * e)[:, None], np.array([[x @ x]])
    short, long = _sandwich(hessian, gradients)[0, 0], _sandwich(hessian, merged(gradients, 1))[0, 0]
    true = 4.0 / (x @ x)
    assert long == pytest.approx(true, rel=3.0 * np.sqrt(2.0 / 500) * 2.0)
    assert short < 0.5 * true


def _regression(rng, clusters, each, leverage=0.0):
    """A regression through the origin: Hessian, gradients at the minimum and Hessians by cluster, and the error."""
    x, e = rng.standard_normal((clusters, each)), rng.standard_normal((clusters, each))
    x[:2] *= np.sqrt(1.0 + leverage)
    e[:2] = 3.0 * rng.standard_normal((2, 1)) * np.sign(x[:2])  # of one cause, in the two that tell most
    own = np.sum(x * x, axis=1)
    found = np.sum(x * e) / own.sum()
    return np.array([[own.sum()]]), np.sum(x * (e - found * x), axis=1)[:, None], own[:, None, None], found


def test_a_jackknife_sees_what_a_fit_bends_to():
    """Two clusters of forty tell nine tenths, and err by one cause each: the sandwich takes what they leave for what
    they are."""
    rng = np.random.default_rng(7)
    draws = [_regression(rng, 40, 50, leverage=180.0) for _ in range(400)]
    scatter = np.mean([found**2 for *_, found in draws])
    plain = np.mean([_sandwich(h, g)[0, 0] for h, g, *_ in draws])
    ours = np.mean([jackknife(h, g, own)[0, 0] for h, g, own, _ in draws])
    assert plain < 0.7 * scatter
    assert 0.8 * scatter < ours < 1.6 * scatter


def test_a_jackknife_of_many_alike_is_the_sandwich():
    rng = np.random.default_rng(8)
    X, e = rng.standard_normal((200, 50, 3)), rng.standard_normal((200, 50))
    own = np.einsum("cti,ctj->cij", X, X)
    gradients, hessian = np.einsum("cti,ct->ci", X, e), own.sum(axis=0)
    np.testing.assert_allclose(
        jackknife(hessian, gradients, own), _sandwich(hessian, gradients), rtol=0.05, atol=1e-6
    )


def test_no_variance_is_below_any_of_the_three():
    """Errors that last for four clusters; a coordinate that only its prior holds; and plain noise, of which every
    estimate by clusters is often too small."""
    rng = np.random.default_rng(6)
    lasting = np.repeat(rng.standard_normal((500, 2)), 4, axis=0) * [1.0, 0.0]
    own = np.zeros((2000, 2, 2))
    own[:, 0, 0] = 1.0
    found = clustered_covariance(np.diag([2000.0, 1.0]), [lasting], [own], [1])
    assert found[0, 0] == pytest.approx(_sandwich(np.diag([2000.0, 1.0]), merged(lasting, 1))[0, 0], rel=0.01)
    assert found[1, 1] == pytest.approx(1.0)
    short = 0
    for _ in range(50):
        gradients = rng.standard_normal((200, 1)) * np.sqrt(10.0 / 200)
        own, hessian = np.full((200, 1, 1), 10.0 / 200), np.array([[10.0]])
        found = clustered_covariance(hessian, [gradients], [own], [1])[0, 0]
        assert found >= 0.1 * (1.0 - 1e-12)
        assert found < 0.1 * 2.0
        short += jackknife(hessian, gradients, own)[0, 0] < found
    assert short > 10


def test_few_clusters_say_nothing_of_correlation():
    """Of three clusters one determines the parameter alone: leaving it out is no evidence against it."""
    own = np.array([98.0, 1.0, 1.0])[:, None, None]
    found = clustered_covariance(np.array([[100.0]]), [np.array([[10.0], [-5.0], [-5.0]])], [own], [1])
    assert found[0, 0] == pytest.approx(0.01)


def _stated_and_true(information, common):
    """Mean variance that is stated, and that of a parameter in many draws, for clusters of this `information` each,
    shape `(c,)`; in each the errors have the `common` factor in their variance that white ones have not."""
    rng, total = np.random.default_rng(9), information.sum()
    hessian, own = np.array([[total]]), information[:, None, None]
    stated, found = [], []
    for _ in range(2000):
        scores = np.sqrt(common * information) * rng.standard_normal(information.size)
        found.append(scores.sum() / total)
        gradients = (information * found[-1] - scores)[:, None]
        stated.append(clustered_covariance(hessian, [gradients], [own], [1])[0, 0])
    return np.mean(stated), np.mean(np.square(found))


def test_correlation_is_stated_of_enough_clusters_only():
    """Of thirty alike the errors that last are known. Of fifteen, one of which tells nine tenths, nothing is: errors
    that are white would seem to last."""
    stated, true = _stated_and_true(np.ones(30), 4.0)
    assert stated == pytest.approx(true, rel=0.15)
    stated, true = _stated_and_true(np.append(np.ones(14), 9.0 * 14.0), 1.0)
    assert stated == pytest.approx(true, rel=0.15)


def _stated(slopes, clustered, *, hessian=None, prior=0.0, at_end=False):
    """Standard errors of values with these `slopes` by two coordinates, of a covariance by information of 1."""
    hessian = np.eye(2) if hessian is None else hessian
    ends = np.full(len(slopes), at_end)
    return standard_errors(np.asarray(slopes), hessian, np.asarray(clustered), np.full(2, prior + 1e-9), ends)


def test_no_value_is_better_known_than_by_the_information():
    """Errors of two coordinates that go together: their ratio seems to be known, and their product is not."""
    found = _stated([[1.0, 0.0], [1.0, -1.0], [1.0, 1.0]], [[4.0, 3.9], [3.9, 4.0]])
    np.testing.assert_allclose(found.stderr, np.sqrt([4.0, 2.0, 15.8]))
    np.testing.assert_allclose(np.diag(found.white), [1.0, 2.0, 2.0])
    np.testing.assert_allclose(np.diag(found.covariance), found.stderr**2)


def test_what_the_data_do_not_determine_has_no_error():
    """At an end of the range; with more than half of the prior's width, by the information alone; not finite."""
    assert np.all(_stated(np.eye(2), np.eye(2), at_end=np.array([True, False])).stderr == [np.inf, 1.0])
    for prior, expected in ((0.49, 3.0), (0.51, np.inf)):
        assert _stated([[1.0, 0.0]], 9.0 * np.eye(2), prior=prior).stderr == [expected]
    # A ratio whose other part is known: judged by both.
    known = _stated([[1.0, 9.0]], np.eye(2), hessian=np.diag([1.0, 1e9]), prior=0.51)
    assert known.stderr == pytest.approx(np.sqrt(82.0))
    for lost in ({"hessian": np.diag([np.nan, 1.0])}, {"clustered": np.diag([np.inf, 1.0])}):
        found = _stated(**({"slopes": np.eye(2), "clustered": np.eye(2)} | lost))
        assert np.all(np.isinf(found.stderr)) and np.all(np.isinf(found.covariance))
