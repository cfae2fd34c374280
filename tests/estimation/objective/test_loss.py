"""What a misfit costs: each loss by itself, and the few numbers that stand for a whole cost in the solver."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, closed_loop, moves, open_loop, stick_noise
from helpers_objective import under
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.estimation import Cauchy, Gaussian, Huber
from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.levenberg_marquardt import small_residuals
from frictionjax.estimation.objective.quadratic import (
    Evaluation,
    EvidenceCoordinates,
    Quadratic,
    quadratic_of,
)
from frictionjax.estimation.objective.robust import robust_posterior

LOSSES = (Gaussian(), Cauchy(), Cauchy(0.1), Cauchy(30.0), Huber(), Huber(0.5))
POWERS = jnp.asarray(np.geomspace(1e-6, 1e9, 400))


def _name(loss):
    return f"{type(loss).__name__}-{float(getattr(loss, 'knee', 1.0)):g}"


each_loss = pytest.mark.parametrize("loss", LOSSES, ids=_name)


@each_loss
def test_no_misfit_costs_nothing(loss):
    assert float(loss.cost(jnp.zeros(()))) == pytest.approx(0.0, abs=1e-15)
    assert bool(jnp.all(loss.cost(POWERS) > 0.0))


@each_loss
def test_the_weight_is_the_slope_of_the_cost(loss):
    slope = jax.vmap(jax.grad(loss.cost))(POWERS)
    np.testing.assert_allclose(loss.weight(POWERS), slope, rtol=1e-12)
    assert bool(jnp.isfinite(jax.grad(loss.cost)(jnp.zeros(()))))


@each_loss
def test_a_larger_misfit_never_weighs_more(loss):
    """Concave: what the root in `small_residuals` rests on, rho >= b rho'."""
    weight = np.asarray(loss.weight(POWERS))
    assert np.all(weight > 0.0)
    assert np.all(np.diff(weight) <= 1e-15)
    assert np.all(np.asarray(loss.cost(POWERS)) >= np.asarray(POWERS) * weight * (1.0 - 1e-12))


def test_a_block_at_the_noise_counts_as_in_least_squares():
    for knee in (0.1, 1.0, 30.0):
        assert float(Cauchy(knee).weight(jnp.ones(()))) == pytest.approx(1.0, rel=1e-12)
    assert float(Huber(4.0).weight(jnp.ones(()))) == 1.0


@pytest.mark.parametrize("knee", [0.5, 4.0])
def test_the_knee_of_huber(knee):
    """Squares up to it, then linear in the error: smooth in value and slope, the force of an outlier constant."""
    loss = Huber(knee)
    below, above = jnp.asarray(knee * (1.0 - 1e-9)), jnp.asarray(knee * (1.0 + 1e-9))
    assert float(loss.cost(0.5 * below)) == 0.5 * float(below)
    assert float(loss.cost(above)) == pytest.approx(float(loss.cost(below)), rel=1e-8)
    assert float(loss.weight(above)) == pytest.approx(1.0, rel=1e-8)
    far = np.array([10.0, 1e3, 1e5]) * knee
    np.testing.assert_allclose(np.asarray(loss.weight(jnp.asarray(far))) * np.sqrt(far), np.sqrt(knee))
    # (error, cost) is a line beyond the knee.
    root, cost = np.sqrt(far), np.asarray(loss.cost(jnp.asarray(far)))
    assert np.diff(cost)[0] / np.diff(root)[0] == pytest.approx(np.diff(cost)[1] / np.diff(root)[1])


def test_far_above_its_knee_cauchy_counts_in_logarithms():
    loss = Cauchy(2.0)
    ratio = float(loss.cost(jnp.asarray(2e12)) - loss.cost(jnp.asarray(2e6))) / np.log(1e6)
    assert ratio == pytest.approx(3.0, rel=1e-5)


def test_knees_are_numbers_and_not_structure():
    """A knee that comes down during a fit compiles nothing anew."""
    for loss in (Cauchy, Huber):
        assert jax.tree.structure(loss(1.0)) == jax.tree.structure(loss(7))
        assert loss(7).knee.dtype == jnp.float64


def _check(near):
    f, A = small_residuals(near)
    size = near.gradient.shape[0]
    assert f.shape == (size + 1,)
    assert A.shape == (size + 1, size)
    scale = np.sqrt(np.diag(near.hessian))
    assert float(f @ f) == pytest.approx(2.0 * float(near.cost), rel=1e-9)
    atol = 1e-9 * np.sqrt(2.0 * float(near.cost))
    np.testing.assert_allclose(np.asarray(A.T @ f) / scale, np.asarray(near.gradient) / scale, atol=atol)
    np.testing.assert_allclose(
        np.asarray(A.T @ A) / np.outer(scale, scale), near.hessian / np.outer(scale, scale), atol=1e-9
    )


@settings(max_examples=40)
@given(st.integers(1, 6), st.integers(0, 2**31), st.floats(1e-6, 1e6))
def test_a_few_residuals_stand_for_any_least_squares(size, seed, scale):
    rng = np.random.default_rng(seed)
    tall = scale * rng.standard_normal((3 * size + 2, size)) * 10.0 ** rng.uniform(-3, 3, size)
    e = rng.standard_normal(3 * size + 2)
    _check(
        Quadratic(jnp.asarray(0.5 * e @ e), jnp.asarray(tall.T @ e), jnp.asarray(tall.T @ tall)),
    )


def _near(q, columns, offset, count, share, loss):
    """The quadratic model at `q` of four recordings with residuals that are straight lines."""
    e = offset + jnp.einsum("q,qbn->bn", q, columns)
    power = jnp.sum(e * e, axis=1) / jnp.maximum(count, 1.0)
    sound = jnp.ones((1, 4), dtype=bool)
    there = Evaluation(e.reshape(1, -1), power[None], columns.reshape(3, 1, -1), sound)
    return quadratic_of(there, count, loss, share, EvidenceCoordinates(3, 3, 0, 3), jnp.ones(1))


_slope = eqx.filter_jit(eqx.filter_grad(lambda q, *case: _near(q, *case).cost))


@settings(max_examples=40)
@given(st.integers(0, 2**31), st.sampled_from(LOSSES), st.floats(0.1, 100.0))
def test_a_few_residuals_stand_for_any_robust_cost(seed, loss, size):
    """The root is real for every concave loss, and the gradient is that of the cost."""
    rng = np.random.default_rng(seed)
    columns, offset = rng.standard_normal((3, 4, 10)), size * rng.standard_normal((4, 10))
    count = np.array([10.0, 10.0, 7.0, 0.0])
    scored = np.arange(10)[None] < count[:, None]
    columns, offset = columns * scored, offset * scored
    share = rng.uniform(0.1, 3.0, 4)
    point = jnp.asarray(rng.standard_normal(3))
    case = *map(jnp.asarray, (columns, offset, count, share)), loss
    found = _near(point, *case)
    _check(found)
    np.testing.assert_allclose(found.gradient, _slope(point, *case), rtol=1e-9, atol=1e-9 * size)


@pytest.fixture(scope="module")
def problem():
    recordings = (
        open_loop("stick", stick_noise(0.9), seed=1),
        closed_loop("move", moves(1.1, (0.2,), (0.5,)), seed=2),
    )
    return robust_posterior(PLANT, make_batch(recordings, encoder_step=FINE), np.zeros(2, bool))


@pytest.mark.parametrize("loss", [Gaussian(), Cauchy(), Huber()], ids=_name)
def test_a_few_residuals_stand_for_recordings(problem, loss):
    made, vector = problem
    away = vector + 0.1 * jnp.asarray(np.random.default_rng(0).standard_normal(vector.shape[0]))
    for point in (vector, away):
        _check(under(made, loss).quadratic(point))


def test_costs_add_up():
    one = Quadratic(jnp.asarray(1.0), jnp.asarray([1.0, 2.0]), jnp.eye(2))
    both = one + one
    assert float(both.cost) == 2.0
    np.testing.assert_array_equal(both.gradient, [2.0, 4.0])
    np.testing.assert_array_equal(both.hessian, 2.0 * np.eye(2))
