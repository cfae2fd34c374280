"""Derivatives of a run, by forward and reverse mode, against finite differences; and what a zero strength does."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import FORMS, LOADS, SMALL, STRENGTHS, TABLE_I, effect, with_every_effect

from frictionjax.physics import Drive, LuGre, Push, mean_of
from frictionjax.simulation import simulate

RATE, N = 2000.0, 240
T = np.arange(N) / RATE
NAMES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
TRUTH = np.array([1.0, 1e5, 1e5**0.5, 0.4, 1.0, 1.5, 1e-3])
U = 1.5 * np.where(T < 0.06, 0.8 * np.sin(2 * np.pi * 50.0 * T), 2.5 * np.sin(2 * np.pi * 25.0 * T))
"""Presliding first, then sliding in both directions."""


@eqx.filter_jit
def _position(logs, u):
    J, *friction = jnp.exp(logs) * TRUTH
    return simulate(Drive(J, LuGre(*friction)), u, RATE).x


WEIGHTS = np.cos(0.1 * np.arange(N))
_forward = jax.jit(jax.jacfwd(_position))
_reverse = jax.jit(jax.grad(lambda logs, u: WEIGHTS @ _position(logs, u)))


def _close(derivative, difference, tolerance):
    scale = np.max(np.abs(difference), axis=0)
    np.testing.assert_array_less(np.max(np.abs(derivative - difference), axis=0), tolerance * scale)


def test_forward_derivatives_agree_with_central_differences():
    """Of the position, by the logarithm of each parameter; fourth-order differences."""
    forward = _forward(jnp.zeros(7), U)
    assert bool(jnp.all(jnp.isfinite(forward)))
    step = 3e-4
    around = step * jnp.concatenate([k * jnp.eye(7) for k in (-2, -1, 1, 2)])
    low2, low, high, high2 = jax.vmap(_position, (0, None))(around, U).reshape(4, 7, N)
    difference = (8.0 * (high - low) - (high2 - low2)) / (12.0 * step)
    _close(forward, np.asarray(difference).T, 1e-6)


def test_reverse_agrees_with_forward():
    reverse = _reverse(jnp.zeros(7), U)
    np.testing.assert_allclose(reverse, WEIGHTS @ _forward(jnp.zeros(7), U), rtol=1e-9)


def test_derivatives_at_rest_are_zero_by_both_modes():
    """v = 0 exactly, at the corner of |v|: nothing moves, whatever the parameters, and nothing is NaN."""
    for derivative in (_forward, _reverse):
        assert not np.any(derivative(jnp.zeros(7), jnp.zeros(N)))


UNITS = np.array([SMALL.get(form, 0.01) for form, _ in STRENGTHS])
"""A small value of each of STRENGTHS, for scale."""
ZERO = jnp.zeros(len(STRENGTHS))
ONE_SIDED = ("delay", "lag", "time_constant", "share", "cut")
NOT_THERE = LOADS[:1]
"""A drive takes one inertia of its own."""
NOT_STEEP = {
    "FrictionLag": "a lag of zero has the derivative zero by construction",
    "WarmupByTemperature": "nobody measured a temperature here",
    "DriveDeadzone": "inputs that are zero to rounding have a sign, and lose nothing",
}

NO_SLOPE = ("FrictionLag", "WarmupByTemperature")


@eqx.filter_jit
def _with_strengths(relative, u):
    """Measured position."""
    drive = with_every_effect(TABLE_I, relative * UNITS, but=NOT_THERE)
    return simulate(drive, u, RATE).measured


_forward_strengths = jax.jit(jax.jacfwd(_with_strengths))


@pytest.mark.parametrize("form", FORMS)
def test_each_effect_of_zero_strength_changes_no_bit(form):
    drive = TABLE_I.with_effects(effect(form))
    x, v, dt = jnp.asarray(1.3e-4), jnp.asarray(-7e-4), jnp.asarray(5e-4)
    u = jnp.asarray(U)
    applied = drive.applied_force(u, dt)
    np.testing.assert_array_equal(mean_of(applied), TABLE_I.applied_force(u, dt))
    assert not isinstance(applied, Push) or not np.any(applied.rise)
    assert float(drive.level(x, v)) == float(TABLE_I.level(x, v))
    assert float(drive.parallel_force(drive.instant(x, v))) == float(
        TABLE_I.parallel_force(TABLE_I.instant(x, v))
    )
    assert float(drive.bristles().share[0]) == 1.0
    assert float(drive.measured(x, dt, jnp.zeros(drive.hidden_count))) == float(x)
    assert float(drive.sigma1(v)) == float(TABLE_I.sigma1(v))
    assert float(drive.slip(x / 1e-3, v)) == float(x / 1e-3)
    assert float(drive.bristle_speed(drive.instant(x, v))) == float(v)


def test_strengths_have_derivatives_at_rest():
    """Only what is a constant force at x = 0 moves a drive at rest, and errors of the sensor show; the others have the
    derivative zero there, not NaN."""
    at_rest = np.asarray(_forward_strengths(ZERO, jnp.zeros(N)))
    assert np.all(np.isfinite(at_rest))
    moving = [name for name, slope in zip(STRENGTHS, at_rest.T, strict=True) if np.any(slope)]
    assert set(moving) == {
        ("ConstantLoad", "load"),
        ("EncoderError", "cosine"),
        ("EncoderErrorWithOvertone", "cosine"),
        ("EncoderErrorWithOvertone", "cosine2"),
        ("GravityPendulum", "cosine"),
        *(("MainsPickup", f"{part}{number}") for part in ("sine", "cosine") for number in ("", "2", "3")),
        ("Ripple", "cosine"),
        ("RippleWithOvertones", "cosine"),
        ("RippleWithOvertones", "cosine2"),
        ("RippleWithOvertones", "cosine3"),
        ("RippleWithOvertones", "cosine4"),
    }


@pytest.mark.slow
def test_strengths_have_reverse_derivatives_at_rest():
    gradient = jax.grad(lambda strengths: _with_strengths(strengths, jnp.zeros(N))[-1])(ZERO)
    assert bool(jnp.all(jnp.isfinite(gradient)))


@pytest.fixture(scope="module")
def slopes():
    """Derivative of the position by each strength at zero; the same by central and by one-sided differences; and the
    position at zero strengths, once for each."""
    forward = np.asarray(_forward_strengths(ZERO, U)).T
    step, one = 1e-3, np.eye(len(STRENGTHS))
    around = step * np.concatenate([one, 2 * one, -one, 0 * one])
    moved = np.asarray(jax.vmap(_with_strengths, (0, None))(around, U))
    ahead, further, behind, zero = moved.reshape(4, len(STRENGTHS), N)
    return forward, (ahead - behind) / (2 * step), (4.0 * ahead - further - 3.0 * zero) / (2 * step), zero


def test_zero_strengths_are_the_base_model_to_the_last_bits(slopes):
    base = np.asarray(simulate(TABLE_I, U, RATE).x)
    for every in slopes[3]:
        np.testing.assert_allclose(every, base, rtol=0, atol=1e-14 * np.ptp(base))


@pytest.mark.parametrize(
    ("index", "name"), [(k, name) for k, name in enumerate(STRENGTHS) if name[0] not in NOT_THERE]
)
def test_each_strength_has_a_derivative_at_zero(slopes, index, name):
    forward, central, one_sided, _ = (rows[index] for rows in slopes)
    assert np.all(np.isfinite(forward))
    assert np.any(forward) == (name[0] not in NO_SLOPE)
    if name[0] not in NOT_STEEP:
        _close(forward, one_sided if name[1] in ONE_SIDED else central, 1e-3)
