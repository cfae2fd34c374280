"""LuGre friction and the drive against closed forms: the numbers that the paper's Table I must give."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import PLANTS, ROTARY, TABLE_I

from frictionjax.physics import Drive, LuGre, linearize
from frictionjax.simulation import simulate

FRICTION = TABLE_I.friction


def test_natural_frequency_damping_and_gain_of_table_i():
    linear = linearize(TABLE_I)
    assert float(linear.natural_frequency) == pytest.approx(50.3292, abs=1e-4)
    assert float(linear.damping_ratio) == pytest.approx(0.50063, abs=1e-5)
    assert float(1.0 / linear.stiffness) == pytest.approx(1e-5, rel=1e-12)
    assert float(linear.damping) == pytest.approx(1e5**0.5 + 0.4, rel=1e-12)


@pytest.mark.parametrize("plant", PLANTS)
def test_level_falls_from_static_to_coulomb_friction(plant):
    friction = PLANTS[plant].friction
    v = np.array([0.0, 0.5, 1.0, -1.0, 2.0, 50.0])
    level = jax.vmap(friction.level)(v * friction.vs)
    expected = friction.Fc + (friction.Fs - friction.Fc) * np.exp(-(v**2))
    np.testing.assert_allclose(level, expected, rtol=1e-14)
    assert float(level[0]) == float(friction.Fs)
    assert float(level[-1]) == float(friction.Fc)


@pytest.mark.parametrize("speed", [1e-5, -1e-3, 0.02, -0.3])
def test_friction_of_steady_sliding_is_the_stribeck_curve(speed):
    v = jnp.asarray(speed)
    z = jnp.sign(v) * FRICTION.level(v)[None] / FRICTION.sigma0
    force, rate = TABLE_I.friction_force(TABLE_I.bristles(), jnp.zeros(()), v, z, jnp.asarray(1e-4))
    assert float(jnp.abs(rate[0])) <= 1e-15 * abs(speed)
    assert float(force) == pytest.approx(float(jnp.sign(v) * FRICTION.level(v) + 0.4 * v), rel=1e-12)


def test_steady_deflection_lies_between_10_and_15_micrometres():
    g = jax.vmap(FRICTION.level)(jnp.linspace(0.0, 0.1, 200)) / FRICTION.sigma0
    assert float(jnp.min(g)) == pytest.approx(1e-5, rel=1e-6)
    assert float(jnp.max(g)) == pytest.approx(1.5e-5, rel=1e-6)


PEAK, RATE = 0.95 * 1.5, 400


@pytest.fixture(scope="module")
def slow_cycle():
    """Fig. 2: the force climbs to 95 % of Fs, falls to minus that, and returns to zero, once in 160 s and in 320 s."""

    def run(quarter):
        up = np.arange(1, quarter * RATE + 1) / (quarter * RATE) * PEAK
        u = np.concatenate([[0.0], up, up[-2::-1], [0.0], -up, -up[-2::-1], [0.0]])
        return u, simulate(TABLE_I, u, RATE)

    return {quarter: run(quarter) for quarter in (40, 80)}


def _virgin(force):
    """Deflection that F = Fs (1 - exp(-sigma0 x/Fs)) gives for a force, m."""
    return -1.5e-5 * np.log(1.0 - force / 1.5)


def test_peak_of_the_virgin_curve_is_44_936_micrometres(slow_cycle):
    assert _virgin(PEAK) == pytest.approx(44.936e-6, abs=5e-10)
    # A ramp of finite slope stays below it by an amount that halves with the slope.
    short = {
        quarter: _virgin(PEAK) - float(run.x[quarter * RATE]) for quarter, (_, run) in slow_cycle.items()
    }
    assert 0.0 < short[80] < short[40] < 0.04e-6
    assert short[40] / short[80] == pytest.approx(2.0, abs=0.1)
    assert 2.0 * short[80] - short[40] == pytest.approx(0.0, abs=0.001e-6)


@pytest.mark.parametrize(("quarter", "gate"), [(40, 0.15e-6), (80, 0.08e-6)])
def test_slow_cycle_follows_the_virgin_curve_and_the_branch_after_the_reversal(slow_cycle, quarter, gate):
    u, run = slow_cycle[quarter]
    x, n = np.asarray(run.x), quarter * RATE
    np.testing.assert_allclose(x[: n + 1], _virgin(u[: n + 1]), atol=gate)
    falling = slice(n, 3 * n)
    branch = x[n] + 1.5e-5 * np.log((1.5 + u[falling]) / (1.5 + PEAK))
    np.testing.assert_allclose(x[falling], branch, atol=gate)


def test_bristle_is_straight_again_when_the_force_is(slow_cycle):
    _, run = slow_cycle[80]
    assert float(jnp.max(run.z)) == pytest.approx(PEAK / 1e5, rel=1e-3)
    assert abs(float(run.z[-1, 0])) < 1e-3 * PEAK / 1e5
    # The position is not: after half the cycle it lacks (Fs/sigma0) ln(Fs + peak)/Fs to be back.
    half = 1.5e-5 * (np.log(20.0) + np.log(1.5 / (1.5 + PEAK)))
    assert float(run.x[2 * 80 * RATE]) == pytest.approx(half, abs=0.1e-6)


def test_numbers_become_arrays_of_float64():
    drive = Drive(1, LuGre(1, 2, 3, 4, 5, 6), motor_constant=2)
    assert {leaf.dtype for leaf in jax.tree.leaves(drive)} == {jnp.dtype("float64")}


def test_motor_constant_turns_the_input_into_a_force():
    u = np.array([0.0, 0.01, -0.02])
    np.testing.assert_allclose(ROTARY.applied_force(jnp.asarray(u), jnp.asarray(1e-3)), 16.0 * u, rtol=1e-15)
    assert ROTARY.bristle_count == 1
