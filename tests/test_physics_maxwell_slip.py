"""Maxwell slip: memory that LuGre has not, with LuGre's stiffness at the origin and LuGre's level in sliding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import TABLE_I, effect

LEVEL, S0, ONE = jnp.asarray(1.5), jnp.asarray(1e5), jnp.asarray(1.0)


@jax.jit
def _along(bristles, path):
    """Quasi-static bristle force, N, along a prescribed path of positions, m (rate independent, so any speed does)."""

    def step(z, dx):
        middle = z + 0.5 * bristles.rate(dx, z, LEVEL, S0, ONE)
        z = bristles.after(z, z + bristles.rate(dx, middle, LEVEL, S0, ONE), dx, LEVEL, S0)
        return z, S0 * jnp.sum(bristles.share * z)

    force = jax.lax.scan(step, jnp.zeros_like(bristles.share), jnp.diff(path))[1]
    return jnp.concatenate([jnp.zeros(1), force])


def _bank(share, shape=1.5):
    return TABLE_I.with_effects(effect("MaxwellSlip", share=share, shape=shape)).bristles()


LEG = 2000
A, B = 20e-6, 8e-6


def _triangles(*corners):
    return np.concatenate(
        [[0.0], *(np.linspace(a, b, LEG + 1)[1:] for a, b in zip((0.0, *corners[:-1]), corners, strict=True))]
    )


@pytest.fixture(scope="module")
def nested():
    """Nested triangles 0, A, -A, A, B, A with B inside: force at each corner, for LuGre and for a whole bank."""
    path = _triangles(A, -A, A, B, A)
    return {share: np.asarray(_along(_bank(share), path))[::LEG] for share in (0.0, 1.0)}


def test_a_nested_loop_closes_where_lugre_s_does_not(nested):
    """Return-point memory: back at A, the force is what it was, however the motion went in between."""
    gap = {share: corners[5] - corners[3] for share, corners in nested.items()}
    assert gap[0.0] < -0.5  # LuGre: a third of Fs is lost in a loop of 12 um
    assert abs(gap[1.0]) < 1e-12


def test_the_outer_loop_closes_too(nested):
    gap = {share: corners[3] - corners[1] for share, corners in nested.items()}
    assert gap[0.0] > 0.15
    assert abs(gap[1.0]) < 1e-12


def test_a_closed_loop_dissipates():
    path = _triangles(A, -A, A)
    force = np.asarray(_along(_bank(1.0), path))
    loop = slice(LEG, None)
    assert np.trapezoid(force[loop], path[loop]) > 0.2 * 2 * A * 1.5


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_initial_stiffness_and_sliding_level_are_those_of_the_base_model(share):
    force = np.asarray(_along(_bank(share), np.linspace(0.0, 3e-4, 30001)))
    assert force[1] / 1e-8 == pytest.approx(1e5, rel=1e-3)
    assert force[-1] == pytest.approx(1.5, rel=1e-6)


def test_with_exponent_1_the_virgin_curve_is_lugre_s_own():
    x = np.linspace(0.0, 6e-5, 6001)
    exponential = 1.5 * (1.0 - np.exp(-x / 1.5e-5))
    np.testing.assert_allclose(
        _along(_bank(1.0, shape=1.0), x), exponential, atol=0.06 * 1.5
    )  # a polygon of 8 sides
    np.testing.assert_allclose(_along(_bank(0.0), x), exponential, atol=1e-6)


@pytest.mark.parametrize("shape", [0.7, 1.0, 2.0, 5.0])
def test_shares_and_yields_are_normalised(shape):
    bank = _bank(0.7, shape)
    assert float(jnp.sum(bank.share)) == pytest.approx(1.0, rel=1e-14)
    assert float(jnp.sum(bank.share * bank.slack)) == pytest.approx(1.0, rel=1e-14)
    assert bool(jnp.all(jnp.diff(bank.slack[1:]) > 0.0))


def test_an_element_that_sticks_follows_the_motion_and_does_not_creep():
    bank, z = _bank(1.0), 1e-6 * jnp.ones(9)
    h = jnp.asarray(1e-5)
    np.testing.assert_allclose(bank.rate(jnp.asarray(0.01), z, LEVEL, S0, h)[1:], 0.01, rtol=1e-9)
    np.testing.assert_array_equal(bank.rate(jnp.zeros(()), z, LEVEL, S0, h), np.zeros(9))
