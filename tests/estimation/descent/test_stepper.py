"""One step and one damping rule, driven from Python and inside a compiled loop; and why a descent ended."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.estimation.descent.levenberg_marquardt import (
    OF_A_FIT,
    equal_curvature,
    levenberg_marquardt,
)
from frictionjax.estimation.descent.stepper import Ending, Stepper, is_small_change
from frictionjax.estimation.objective.quadratic import AbstractObjective, Quadratic

SLOPES = np.array([[1.0, 2.0, 0.3], [0.0, 1e-3, 0.2], [3.0, 1.0, 1e3], [0.5, 0.1, 0.7]])


class Bent(AbstractObjective):
    """Rosenbrock's valley, in which every residual counts 1: minimum 0 at (1, 1)."""

    def quadratic(self, vector):
        x, y = vector
        residual = jnp.stack([1.0 - x, 10.0 * (y - x**2)])
        slope = jnp.stack(
            [jnp.stack([-jnp.ones_like(x), jnp.zeros_like(x)]), jnp.stack([-20.0 * x, 10.0 + 0.0 * x])]
        )
        return Quadratic(0.5 * residual @ residual, slope.T @ residual, slope.T @ slope)


class Rough(AbstractObjective):
    """A cost that no step lowers, although its slope promises more."""

    def quadratic(self, vector):
        return Quadratic(100.0 + jnp.sum(jnp.abs(vector)), jnp.ones(2), jnp.eye(2))


class Lost(AbstractObjective):
    """A run that overflows."""

    def quadratic(self, vector):
        return Quadratic(jnp.asarray(jnp.inf), jnp.full(2, jnp.nan), jnp.full((2, 2), jnp.nan))


def test_a_step_solves_the_damped_equations():
    """(H + damping diag H) step = -g: Marquardt's scaling, by NumPy and by JAX."""
    hessian, gradient = SLOPES.T @ SLOPES, np.array([1.0, -2.0, 30.0])
    stepper = Stepper(longest=np.inf)
    for damping in (0.0, 0.03, 10.0):
        expected = -np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
        for kind in (np.asarray, jnp.asarray):
            step = stepper.step(kind(hessian), kind(gradient), damping)
            np.testing.assert_allclose(step, expected, rtol=1e-8)


def test_no_coordinate_goes_further_than_the_longest_step():
    step = Stepper(longest=1.5).step(np.eye(3), np.array([9.0, -0.5, -9.0]), 0.0)
    assert step.tolist() == [-1.5, 0.5, 1.5]
    own = Stepper().step(np.eye(3), np.array([9.0, -0.5, -9.0]), 0.0, np.array([1.0, 0.1, 5.0]))
    assert own.tolist() == [-1.0, 0.1, 5.0]


def test_the_damping_falls_after_a_success_and_rises_after_a_failure():
    stepper = Stepper(easing=5.0, raising=8.0, least=1e-6)
    assert stepper.judged(1.0, -1e-9) == (True, 0.2)
    assert stepper.judged(2e-6, -1.0) == (True, 1e-6)
    for change in (0.0, 1.0, np.nan, np.inf):
        assert stepper.judged(1.0, change) == (False, 8.0)


def test_a_step_is_judged_by_what_was_predicted():
    stepper = Stepper(easing=5.0, raising=8.0, enough=0.01, good=0.9)
    changes = jnp.asarray([-9.5, -5.0, -0.05, 1.0, jnp.nan])
    accepted, damping = jax.vmap(lambda change: stepper.judged(jnp.asarray(1.0), change, -10.0))(changes)
    assert accepted.tolist() == [True, True, False, False, False]
    assert damping.tolist() == [0.2, 1.0, 8.0, 8.0, 8.0]


@pytest.mark.parametrize("kind", [float, jnp.asarray], ids=["NumPy", "JAX"])
def test_small_steps_in_a_row_are_the_last(kind):
    """A long step starts the count again, a rejected one does not; it is the last where damping is at its most."""
    stepper = Stepper(damping=1.0, raising=8.0, most=100.0, in_a_row=2)
    after = jax.jit(stepper.after) if kind is jnp.asarray else stepper.after

    def endings(steps):
        course, found = stepper.first, []
        for change, small in steps:
            course = after(course, kind(change), kind(change), bool(small) if kind is float else kind(small))
            found.append(Ending.of(course.ending))
            assert bool(course.ended) is (found[-1] is not Ending.STEPS)
        return found

    goes_on, at_rest = Ending.STEPS, Ending.AT_REST
    assert endings([(-1.0, True), (-1.0, True)]) == [goes_on, at_rest]
    assert endings([(-1.0, True), (-1.0, False), (-1.0, True)]) == [goes_on] * 3
    assert endings([(-1.0, True), (1.0, True), (-1.0, True)]) == [goes_on, goes_on, at_rest]
    assert endings([(1.0, True)] * 3) == [goes_on, goes_on, Ending.NO_STEP]


def test_a_change_is_small_where_each_value_hardly_moves():
    """Below the tolerance, or below a thousandth of a large value."""
    for change, small in (([0.009, 0.5], True), ([0.02, 0.5], False), ([0.009, 2.0], False)):
        for kind in (np.asarray, jnp.asarray):
            found = is_small_change(kind([0.0, 1e3]), kind(change), 0.01)
            assert bool(found) is small


# Outside of transformations by NumPy; inside by a compiled loop.
DESCENTS = [levenberg_marquardt, eqx.filter_jit(levenberg_marquardt)]


@pytest.mark.parametrize("descent", DESCENTS, ids=["step by step", "compiled"])
@pytest.mark.parametrize("stepper", [OF_A_FIT, Stepper(longest=9.0)], ids=["of a fit", "of a diagnosis"])
def test_a_descent_takes_the_steps_of_its_stepper(stepper, descent):
    """Every step of it, from a place from which some of them fail."""
    objective, vector = Bent(), jnp.asarray([-1.2, 1.0])
    unit = equal_curvature(objective, vector)
    places, damping = [np.asarray(vector)], stepper.damping
    near, proposed = objective.quadratic(vector), vector
    for number in range(12):
        if number > 0:
            there = objective.quadratic(proposed)
            step, hessian, gradient = (
                np.asarray(a) for a in (proposed - vector, near.hessian, near.gradient)
            )
            predicted = gradient @ step + 0.5 * step @ hessian @ step
            accepted, damping = stepper.judged(damping, float(there.cost) - float(near.cost), predicted)
            if accepted:
                vector, near = proposed, there
        places.append(np.asarray(vector))
        hessian, gradient = np.asarray(near.hessian * jnp.outer(unit, unit)), np.asarray(near.gradient * unit)
        proposed = vector + unit * stepper.step(hessian, gradient, damping)
    for count in (1, 2, 5, 12):
        start = jnp.asarray([-1.2, 1.0])
        found = descent(objective, start, unit, count, stepper=stepper, tolerance=1e-9)
        np.testing.assert_allclose(found.vector, places[count], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("descent", DESCENTS, ids=["step by step", "compiled"])
@pytest.mark.parametrize(
    ("objective", "steps", "ending"),
    [
        (Bent(), 60, Ending.AT_REST),
        (Bent(), 3, Ending.STEPS),
        (Rough(), 60, Ending.NO_STEP),
        (Lost(), 60, Ending.NOT_FINITE),
    ],
    ids=lambda value: getattr(value, "name", type(value).__name__),
)
def test_a_descent_says_why_it_ended(objective, steps, ending, descent):
    vector = jnp.asarray([-1.2, 1.0]) if isinstance(objective, Bent) else jnp.zeros(2)
    found = descent(objective, vector, jnp.ones(2), steps)
    assert list(Ending)[int(found.ending)] is ending
    if ending is Ending.AT_REST:
        np.testing.assert_allclose(found.vector, [1.0, 1.0], atol=1e-2)
        assert int(found.steps) == int(levenberg_marquardt(objective, vector, jnp.ones(2), steps).steps)
    if ending in (Ending.NO_STEP, Ending.NOT_FINITE):
        np.testing.assert_array_equal(found.vector, vector)
