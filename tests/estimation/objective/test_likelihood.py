"""Residuals, their Jacobian, the robust likelihood, and least squares by two roads."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, VOLT, closed_loop, moves, open_loop, stick_noise
from helpers_objective import under
from scipy.optimize import least_squares, minimize

from frictionjax.estimation.data.batch import make_batch
from frictionjax.estimation.descent.levenberg_marquardt import equal_curvature, levenberg_marquardt
from frictionjax.estimation.descent.robust import descend
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.loss import Cauchy, Gaussian, Huber
from frictionjax.estimation.objective.misfit import losses_of, misfit_of
from frictionjax.estimation.objective.quadratic import all_columns
from frictionjax.estimation.objective.robust import graduated, robust_posterior


@eqx.filter_jit
def _lanes(posterior, vectors):
    e = jax.vmap(lambda vector: posterior.errors(vector, 0))(vectors)
    return e.reshape(vectors.shape[0], posterior.batch.x.shape[0], -1)


@pytest.fixture(scope="module")
def batch():
    """Half a second of stick and one move, of different lengths."""
    return make_batch(
        (
            open_loop("stick", stick_noise(0.9), seed=1),
            closed_loop("move", moves(1.1, (0.2,), (0.5,)), seed=2),
        ),
        encoder_step=FINE,
    )


@pytest.fixture(scope="module")
def problem(batch):
    return robust_posterior(PLANT, batch, np.zeros(2, bool))


@pytest.fixture(scope="module")
def slopes(problem):
    """Innovations and Jacobian at the true parameters."""
    (there,) = problem[0].evaluated(problem[1])
    e, jacobian = there.e, all_columns(there)
    return problem[0].layout, np.asarray(e), np.asarray(jacobian)


def _central(function, vector, step):
    around = step * np.eye(len(vector))
    moved = np.asarray(function(jnp.asarray(np.concatenate([vector + around, vector - around]))))
    return (moved[: len(vector)] - moved[len(vector) :]) / (2.0 * step)


def _apart(derivative, difference):
    """Distance of two derivatives over the size of the second, for each column and recording that it moves."""
    size = np.sqrt(np.mean(difference**2, axis=-1))
    distance = np.sqrt(np.mean((derivative - difference) ** 2, axis=-1))
    return np.where(size > 0.0, distance / np.where(size > 0.0, size, 1.0), distance)


def test_jacobian_agrees_with_central_differences(problem, slopes):
    """To second order in the step: the derivatives of the step's matrix are left out, which costs half a percent."""
    _, _, jacobian = slopes
    difference = _central(lambda q: _lanes(problem[0], q), np.asarray(problem[1]), 1e-5)
    apart = _apart(jacobian, difference)
    assert np.max(apart) < 0.01
    # It is no accident of rounding that they differ: what is left out is there.
    assert np.max(apart) > 1e-4


@pytest.mark.slow
def test_what_the_jacobian_leaves_out_is_of_second_order(problem, batch):
    """Half the step, a quarter of the difference, for every parameter that moves the innovations of the stick."""
    posterior, vector, count = problem[0], np.asarray(problem[1]), len(problem[0].layout)

    def errors(q, substeps):
        return posterior.recordings.standardised(posterior.drive_of(q), q[count:], finer=substeps)[0]

    apart = []
    for substeps in (1, 2):
        forward = jax.jit(jax.jacfwd(lambda q, k=substeps: errors(q, k)))(jnp.asarray(vector))
        lanes = jax.jit(jax.vmap(lambda q, k=substeps: errors(q, k)))
        difference = _central(lanes, vector, 1e-5)
        apart.append(_apart(np.asarray(forward).T, difference)[:count])
    np.testing.assert_allclose(apart[0] / apart[1], 4.0, rtol=0.15)


def test_a_starting_deflection_moves_its_own_recording_only(slopes):
    _, _, jacobian = slopes
    assert not np.any(jacobian[7, 1])
    assert not np.any(jacobian[8, 0])
    assert np.any(jacobian[7, 0])
    assert np.any(jacobian[8, 1])


def test_nothing_is_scored_before_the_observer_has_settled(slopes, batch):
    _, e, jacobian = slopes
    assert not np.any(e[:, :200])
    assert not np.any(jacobian[:, :, :200])
    assert not np.any(e[0, batch.lengths[0] :])


def _differences(function, vector, step):
    around = step * np.eye(len(vector))
    return np.array([(function(vector + e) - function(vector - e)) / (2.0 * step) for e in around])


@pytest.mark.parametrize("knee", [1.0, 20.0])
def test_the_robust_cost_is_a_cauchy_likelihood(problem, knee):
    """Cost by hand from the block powers; and the gradient is its slope, up to what the Jacobian leaves out."""
    posterior, vector = problem
    away = vector + jnp.asarray([0.05, -0.1, 0.2, 0.1, -0.05, 0.1, 0.2, 0.1, 0.1])
    posterior = graduated(posterior, knee)
    near = posterior.near(away)
    power, count = posterior.powers([away])[0], np.asarray(posterior.batch.block_count)
    np.testing.assert_allclose(near.powers[0], power, rtol=1e-9)
    off = np.asarray((away - posterior.start) * posterior.prior)
    cost = np.sum(count * np.log((power + knee) / knee)) + 0.5 * off @ off
    assert float(near.cost) == pytest.approx(cost, rel=1e-9)
    slope = _differences(lambda q: float(posterior.near(jnp.asarray(q)).cost), np.asarray(away), 1e-5)
    size = np.sqrt(np.diag(near.hessian))
    assert np.max(np.abs(np.asarray(near.gradient) - slope) / size) < 0.01 * np.max(np.abs(slope) / size)
    np.testing.assert_allclose(near.hessian, np.asarray(near.hessian).T, rtol=1e-9, atol=1e-6)
    assert np.min(np.linalg.eigvalsh(near.hessian)) > 0.0


def test_misfit_is_zero_at_the_floor_and_the_logarithm_far_above(batch):
    blocks, both = np.ones(batch.block_count.shape), np.ones(2)
    count = np.asarray(batch.block_count)
    assert misfit_of(blocks, both, batch) == pytest.approx(0.0, abs=1e-12)
    assert misfit_of(1e6 * blocks, both, batch) == pytest.approx(0.5 * np.log((1e6 + 1) / 2))
    np.testing.assert_allclose(losses_of(1.3 * blocks, batch, 1.3), 0.0, atol=1e-9)
    # One wild block counts by its logarithm, not by its square.
    wild = blocks.copy()
    wild[0, 5] = 1e8
    part = count[0, 5] / np.sum(count)
    assert misfit_of(wild, both, batch) == pytest.approx(part * 0.5 * np.log((1e8 + 1) / 2), rel=1e-9)
    # A held-out recording counts for nothing, one that is not finite for everything.
    assert misfit_of(wild, np.array([0.0, 1.0]), batch) == pytest.approx(0.0, abs=1e-12)
    wild[0, 5] = np.nan
    assert misfit_of(wild, both, batch) == float("inf")


def test_blocks_without_scored_samples_count_for_nothing(batch):
    empty = np.asarray(batch.block_count) == 0
    assert empty.any()
    assert misfit_of(np.where(empty, 1e12, 1.0), np.ones(2), batch) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "loss",
    [
        Gaussian(),
        pytest.param(Cauchy(), marks=pytest.mark.slow),
        pytest.param(Huber(1.2), marks=pytest.mark.slow),
    ],
    ids=lambda loss: type(loss).__name__,
)
def test_two_roads_of_least_squares(problem, loss):
    """optimistix on the compressed cost, in forward mode, against scipy on one residual for every sample, with
    numerical derivatives. A block's residuals are its errors times sqrt(rho(b)/b): their squares sum to n rho(b)."""
    made, vector = problem
    batch = made.batch
    away = np.asarray(vector) + np.array([0.05, -0.1, 0.2, 0.1, -0.05, 0.1, 0.2, 0.0, 0.1])

    def residual(points):
        e = _lanes(made, jnp.asarray(points))
        power = jax.vmap(lambda lane: block_power(lane, batch))(e)
        safe = jnp.where(power > 0.0, power, 1.0)
        root = jnp.repeat(jnp.sqrt(loss.cost(safe) / safe), batch.block, axis=-1)
        prior = (points - np.asarray(made.start)) * np.asarray(made.prior)
        return np.concatenate([np.asarray(e * root).reshape(len(points), -1), prior], axis=1)

    def slope(q):
        h = 1e-5 * np.eye(q.size)
        moved = residual(np.concatenate([q + h, q - h]))
        return ((moved[: q.size] - moved[q.size :]) / 2e-5).T

    scipys = least_squares(lambda q: residual(q[None])[0], away, slope, xtol=1e-12, ftol=1e-12, gtol=1e-10)
    objective = under(made, loss)
    unit = equal_curvature(objective, jnp.asarray(away))
    found = levenberg_marquardt(objective, jnp.asarray(away), unit, 60, tolerance=1e-4)
    ours = found.vector
    assert 1 < int(found.steps) < 60
    cost = 0.5 * float(np.sum(residual(np.asarray(ours)[None]) ** 2))
    assert float(found.cost) == pytest.approx(cost, rel=1e-9)
    assert cost == pytest.approx(scipys.cost, rel=1e-5)
    assert cost < 0.9 * 0.5 * np.sum(residual(away[None]) ** 2)
    stderr = np.sqrt(np.diag(np.linalg.inv(objective.quadratic(ours).hessian)))
    assert np.max(np.abs(np.asarray(ours) - scipys.x) / stderr) < 0.05


def test_a_failing_step_keeps_the_best_vector(problem):
    """From a start whose run overflows, nothing is thrown and nothing is lost."""
    made, vector = problem
    start, objective = jnp.asarray(vector).at[0].set(jnp.nan), under(made, Cauchy())
    unit = equal_curvature(objective, start)
    assert bool(jnp.all(jnp.isfinite(unit)))
    found = levenberg_marquardt(objective, start, unit, 60).vector
    assert found.shape == vector.shape


def test_units_have_equal_curvature(problem):
    made, vector = problem
    objective = under(made, Cauchy())
    unit = np.asarray(equal_curvature(objective, vector))
    bent = unit[:, None] * np.asarray(objective.quadratic(vector).hessian) * unit[None]
    np.testing.assert_allclose(np.diag(bent), np.diag(bent)[0], rtol=1e-9)


def test_a_robust_descent_ends_where_scipy_does(problem):
    """The same likelihood as residuals sqrt(log((b + 1)/2)) would have; scipy knows its cost alone."""
    posterior, vector = problem
    away = np.asarray(vector) + np.array([0.05, -0.1, 0.2, 0.1, -0.05, 0.1, 0.2, 0.0, 0.1])
    found = descend(posterior, jnp.asarray(away), tolerance=1e-6)
    assert found.converged
    assert found.misfit == pytest.approx(posterior.misfits([found.vector])[0], rel=1e-9)
    unit = 1.0 / np.sqrt(np.diag(found.near.hessian))
    ends = minimize(
        lambda step: float(posterior.near(jnp.asarray(np.asarray(found.vector) + unit * step)).cost),
        np.zeros(away.size),
        jac=lambda step: (
            unit * np.asarray(posterior.near(jnp.asarray(np.asarray(found.vector) + unit * step)).gradient)
        ),
        method="BFGS",
        options={"gtol": 1e-2, "maxiter": 40},
    )
    assert float(found.near.cost) < ends.fun + 0.02
    assert found.misfit < 0.5 * posterior.misfits([away])[0]


@pytest.mark.parametrize("deflection", [-0.5, 0.3])
def test_a_known_starting_deflection_is_recovered_in_a_held_out_recording(deflection):
    """A machine left with its bristle bent, and held there by the input that this asks for."""
    bent = deflection * float(PLANT.friction.Fs / PLANT.friction.sigma0)
    held = open_loop("held", deflection * VOLT + 0.3 * stick_noise(0.9), seed=1, z0=bent)
    at_rest = open_loop("rest", stick_noise(0.9), seed=2)
    batch = make_batch((held, at_rest), encoder_step=FINE)
    posterior, vector = robust_posterior(PLANT, batch, np.array([True, False]))
    scored = np.asarray(batch.block_count) > 0
    assert posterior.powers([vector])[0][0][scored[0]].mean() > 2.0
    found = descend(posterior, vector)
    # What the observer has not forgotten after 0.1 s is little: the deflection counts by what it leaves unexplained.
    assert float(found.vector[-2]) == pytest.approx(deflection, abs=0.15)
    assert float(found.vector[-1]) == pytest.approx(0.0, abs=0.02)
    for row in (0, 1):
        assert np.asarray(found.near.powers[0])[row][scored[row]].mean() == pytest.approx(1.0, rel=0.15)


def test_no_parameter_sees_a_held_out_recording(batch):
    """Whatever it holds: here its input is another one, and its power dozens of times the noise."""
    posterior, vector = robust_posterior(PLANT, batch, np.array([False, True]))
    spoiled = eqx.tree_at(
        lambda j: j.evidence[0].batch.u, posterior, jnp.asarray(batch.u).at[1].multiply(1.2)
    )
    start = jnp.asarray(vector).at[0].add(0.05)
    ends = [descend(one, start) for one in (posterior, spoiled)]
    np.testing.assert_allclose(ends[0].vector[:8], ends[1].vector[:8], rtol=0, atol=1e-9)
    assert ends[0].misfit == pytest.approx(ends[1].misfit, rel=1e-9)
    scored = np.asarray(batch.block_count)[1] > 0
    assert np.asarray(ends[1].near.powers[0])[1][scored].mean() > 20.0


def test_layouts_of_other_numbers_have_one_structure(problem):
    """Scales and bounds are numbers of the case: layouts that differ in them alone must not compile twice."""
    layout = problem[0].layout
    again = tuple(dataclasses.replace(free, scale=2.0, upper=7.0) for free in layout)
    assert jax.tree.structure(layout) == jax.tree.structure(again)
