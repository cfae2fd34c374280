"""Residuals, their Jacobian, the robust likelihood, and least squares by two roads."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_estimation import FINE, PLANT, VOLT, closed_loop, moves, open_loop, stick_noise
from scipy.optimize import least_squares

from frictionjax.estimation.batch import make_batch
from frictionjax.estimation.deflection import fit_deflections
from frictionjax.estimation.least_squares import (
    Innovations,
    equal_curvature,
    jacobian_of,
    levenberg_marquardt,
    predicted_errors,
)
from frictionjax.estimation.loss import Cauchy, Gaussian, Huber
from frictionjax.estimation.parameters import unpack
from frictionjax.estimation.problem import make_problem
from frictionjax.estimation.residuals import block_power, mismatch, standardised, weights

_lanes = eqx.filter_jit(jax.vmap(predicted_errors, (None, 0, None)))


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
    return make_problem(PLANT, batch)


@pytest.fixture(scope="module")
def slopes(problem):
    """Innovations and Jacobian at the true parameters."""
    layout, (e, jacobian) = problem[0].layout, jacobian_of(problem[0].layout, problem[1], problem[0].setting)
    return layout, np.asarray(e), np.asarray(jacobian)


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
    layout, _, jacobian = slopes
    difference = _central(lambda q: _lanes(layout, q, problem[0].setting), np.asarray(problem[1]), 1e-5)
    apart = _apart(jacobian, difference)
    assert np.max(apart) < 0.01
    # It is no accident of rounding that they differ: what is left out is there.
    assert np.max(apart) > 1e-4


@pytest.mark.slow
def test_what_the_jacobian_leaves_out_is_of_second_order(problem, batch):
    """Half the step, a quarter of the difference, for every parameter that moves the innovations of the stick."""
    setting, vector, count = problem[0].setting, np.asarray(problem[1]), len(problem[0].layout)

    def errors(q, substeps):
        drive = unpack(problem[0].layout, PLANT, q[:count], setting.start[:count])
        return standardised(drive, q[count:], batch, setting.gains, substeps=substeps)[0]

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


def test_weights_are_those_of_a_cauchy_likelihood(batch):
    """weight = 1/(block power + knee^2): the derivative of 1/2 log(power + knee^2) by 1/2 power, in every block."""
    power = jnp.asarray(np.random.default_rng(0).uniform(0.5, 50.0, batch.block_count.shape))
    floor = jnp.asarray(1.7)
    weight = np.asarray(weights(power, jnp.sqrt(floor), batch))
    slope = jax.grad(lambda p: mismatch(p, floor, batch))(power) * jnp.sum(batch.block_count)
    per_block = np.asarray(batch.block_mean(jnp.asarray(weight)) * batch.block_count)
    np.testing.assert_allclose(per_block, 2.0 * np.asarray(slope), rtol=1e-12)
    assert not np.any(weight[np.asarray(batch.valid) == 0.0])


def test_misfit_is_zero_at_the_floor_and_the_logarithm_far_above(batch):
    floor = jnp.asarray(1.3)
    blocks = jnp.ones(batch.block_count.shape)
    assert float(mismatch(1.3 * blocks, floor, batch)) == pytest.approx(0.0, abs=1e-12)
    assert float(mismatch(1.3e6 * blocks, floor, batch)) == pytest.approx(0.5 * np.log((1e6 + 1) / 2))
    # One wild block counts by its logarithm, not by its square.
    wild = blocks.at[0, 5].set(1e8)
    part = float(batch.block_count[0, 5] / jnp.sum(batch.block_count))
    found = float(mismatch(1.3 * wild, floor, batch))
    assert found == pytest.approx(part * 0.5 * np.log((1e8 + 1) / 2), rel=1e-9)


def test_blocks_without_scored_samples_count_for_nothing(batch):
    empty = np.asarray(batch.block_count) == 0
    assert empty.any()
    power = jnp.asarray(np.where(empty, 1e12, 2.0))
    assert float(mismatch(power, jnp.asarray(2.0), batch)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("loss", [Gaussian(), Cauchy(), Huber(1.2)], ids=lambda loss: type(loss).__name__)
def test_two_roads_of_least_squares(problem, loss):
    """optimistix on the compressed cost, in forward mode, against scipy on one residual for every sample, with
    numerical derivatives. A block's residuals are its errors times sqrt(rho(b)/b): their squares sum to n rho(b)."""
    made, vector = problem
    setting, layout, batch = made.setting, made.layout, made.setting.batch
    away = np.asarray(vector) + np.array([0.05, -0.1, 0.2, 0.1, -0.05, 0.1, 0.2, 0.0, 0.1])

    def residual(points):
        e = _lanes(layout, jnp.asarray(points), setting)
        power = jax.vmap(lambda lane: block_power(lane, batch))(e)
        safe = jnp.where(power > 0.0, power, 1.0)
        root = jnp.repeat(jnp.sqrt(loss.cost(safe) / safe), batch.block, axis=-1)
        prior = (points - np.asarray(setting.start)) * np.asarray(setting.prior)
        return np.concatenate([np.asarray(e * root).reshape(len(points), -1), prior], axis=1)

    def slope(q):
        h = 1e-5 * np.eye(q.size)
        moved = residual(np.concatenate([q + h, q - h]))
        return ((moved[: q.size] - moved[q.size :]) / 2e-5).T

    scipys = least_squares(lambda q: residual(q[None])[0], away, slope, xtol=1e-12, ftol=1e-12, gtol=1e-10)
    objective = Innovations(layout, setting, loss)
    unit = equal_curvature(objective, jnp.asarray(away))
    ours, least, count, _ = levenberg_marquardt(objective, jnp.asarray(away), unit, 60, tolerance=1e-4)
    assert 1 < int(count) < 60
    cost = 0.5 * float(np.sum(residual(np.asarray(ours)[None]) ** 2))
    assert float(least) == pytest.approx(cost, rel=1e-9)
    assert cost == pytest.approx(scipys.cost, rel=1e-5)
    assert cost < 0.9 * 0.5 * np.sum(residual(away[None]) ** 2)
    stderr = np.sqrt(np.diag(np.linalg.inv(objective.quadratic(ours).hessian)))
    assert np.max(np.abs(np.asarray(ours) - scipys.x) / stderr) < 0.05


def test_a_failing_step_keeps_the_best_vector(problem):
    """From a start whose run overflows, nothing is thrown and nothing is lost."""
    made, vector = problem
    start, objective = vector.at[0].set(jnp.nan), Innovations(made.layout, made.setting, Cauchy())
    unit = equal_curvature(objective, start)
    assert bool(jnp.all(jnp.isfinite(unit)))
    found = levenberg_marquardt(objective, start, unit, 60).vector
    assert found.shape == vector.shape


def test_units_have_equal_curvature(problem):
    made, vector = problem
    objective = Innovations(made.layout, made.setting, Cauchy())
    unit = np.asarray(equal_curvature(objective, vector))
    bent = unit[:, None] * np.asarray(objective.quadratic(vector).hessian) * unit[None]
    np.testing.assert_allclose(np.diag(bent), np.diag(bent)[0], rtol=1e-9)


@pytest.mark.parametrize("deflection", [-0.5, 0.3])
def test_a_known_starting_deflection_is_recovered(deflection):
    """A machine left with its bristle bent, and held there by the input that this asks for."""
    bent = deflection * float(PLANT.friction.Fs / PLANT.friction.sigma0)
    held = open_loop("held", deflection * VOLT + 0.3 * stick_noise(0.9), seed=1, z0=bent)
    at_rest = open_loop("rest", stick_noise(0.9), seed=2)
    batch = make_batch((held, at_rest), encoder_step=FINE)
    problem, _ = make_problem(PLANT, batch)
    gains = problem.setting.gains
    scored = np.asarray(batch.block_count) > 0
    unbent = standardised(PLANT, jnp.zeros(2), batch, gains)
    assert np.asarray(block_power(unbent, batch))[0][scored[0]].mean() > 2.0
    found, e = fit_deflections(PLANT, batch, gains)
    # What the observer has not forgotten after 0.1 s is little: the deflection counts by what it leaves unexplained.
    assert float(found[0]) == pytest.approx(deflection, abs=0.15)
    assert float(found[1]) == pytest.approx(0.0, abs=0.02)
    power = np.asarray(block_power(e, batch))
    for row in (0, 1):
        assert power[row][scored[row]].mean() == pytest.approx(1.0, rel=0.15)


def test_layouts_of_other_numbers_have_one_structure(problem):
    """Scales and bounds are numbers of the case: layouts that differ in them alone must not compile twice."""
    layout = problem[0].layout
    again = tuple(dataclasses.replace(free, scale=2.0, upper=7.0) for free in layout)
    assert jax.tree.structure(layout) == jax.tree.structure(again)
