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

    limit = bristles.limit(LEVEL, S0)

    def step(z, dx):
        middle = z + 0.5 * bristles.rate(dx, dx, S0 * z / LEVEL, dx)
        z = bristles.within(z + bristles.rate(dx, dx, S0 * middle / LEVEL, dx), limit)
        return z, S0 * jnp.sum(bristles.share * z)

    force = jax.lax.scan(step, jnp.zeros_like(bristles.share), jnp.diff(path))[1]
    return jnp.concatenate([jnp.zeros(1), force])


def _bank(share, **spread):
    return TABLE_I.with_effects(effect("MaxwellSlip", share=share, **spread)).bristles()


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


def test_with_spread_1_9_and_skew_0_5_the_virgin_curve_is_near_lugre_s_own():
    x = np.linspace(0.0, 6e-5, 6001)
    exponential = 1.5 * (1.0 - np.exp(-x / 1.5e-5))
    polygon = _along(_bank(1.0, spread=1.9, skew=-0.5), x)
    np.testing.assert_allclose(polygon, exponential, atol=0.08 * 1.5)
    np.testing.assert_allclose(_along(_bank(0.0), x), exponential, atol=1e-6)


@pytest.mark.parametrize(("spread", "skew"), [(0.1, 0.0), (1.5, 0.0), (1.9, -0.5), (4.0, 1.5)])
def test_shares_and_yields_are_normalised(spread, skew):
    bank = _bank(0.7, spread=spread, skew=skew)
    assert float(jnp.sum(bank.share)) == pytest.approx(1.0, rel=1e-14)
    assert float(jnp.sum(bank.share * bank.slack)) == pytest.approx(1.0, rel=1e-14)
    assert bool(jnp.all(bank.slack > 0.0))
    assert float(jnp.mean(bank.slack[1:])) == pytest.approx(1.0, rel=1e-14)


def test_a_few_elements_yield_where_they_are_reported_to():
    """Virgin curve of four elements: its slope falls by each one's share at its own deflection, and there only."""
    steps, weights = np.array([0.4, 1.2, 0.8]), np.array([2.0, 0.5, 1.5])
    given = {f"step{i + 1}": step for i, step in enumerate(steps)}
    given |= {f"weight{i + 1}": weight for i, weight in enumerate(weights)}
    bank = TABLE_I.with_effects(effect("FewElements", share=1.0, **given)).bristles()
    share = np.concatenate([[1.0], weights]) / (1.0 + weights.sum())
    yields = np.exp(np.concatenate([[0.0], np.cumsum(steps)]))
    yields *= 1.5e-5 / (share @ yields)
    x = np.linspace(0.0, 6e-5, 6001)
    expected = 1e5 * np.sum(share * np.minimum(x[:, None], yields), axis=1)
    np.testing.assert_allclose(_along(bank, x), expected, atol=1e-3)
    assert float(jnp.sum(bank.share * bank.slack)) == pytest.approx(1.0, rel=1e-14)


def test_an_element_moves_with_the_machine_until_it_yields():
    drive = TABLE_I.with_effects(effect("MaxwellSlip", share=1.0))
    bristles, zero, h = drive.bristles(), jnp.zeros(()), jnp.asarray(1e-5)
    limit = bristles.limit(LEVEL, S0)

    def rate(v, z):
        return drive.friction_force(bristles, zero, jnp.asarray(v), z, h)[1][1:]

    np.testing.assert_allclose(rate(1e-3, 0.5 * limit), 1e-3, rtol=1e-12)
    np.testing.assert_array_equal(rate(0.0, 0.5 * limit), np.zeros(limit.size - 1))  # no creep at rest
    np.testing.assert_array_equal(rate(0.01, limit), np.zeros(limit.size - 1))  # slips, at a lower level
    np.testing.assert_allclose(rate(-1e-3, limit), -1e-3, rtol=1e-12)  # turns back
    at_half = rate(1e-3, limit - 0.5 * h * 1e-3)
    level = float(drive.level(zero, jnp.asarray(1e-3)))
    assert level < 1.5 and not np.any(at_half)  # the level has fallen below it
    level_now = bristles.limit(drive.level(zero, jnp.asarray(1e-3)), S0)
    np.testing.assert_allclose(rate(1e-3, level_now - 0.5e-8), 0.5e-3, rtol=1e-9)  # yields half-way
