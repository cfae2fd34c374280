"""Linearisation: left and right Jacobians, against the matrix of the paper and against finite differences."""

import subprocess
import sys

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import LOADS, PLANTS, ROTARY, STRENGTHS, TABLE_I, effect, with_every_effect

from frictionjax.physics import linearize


@pytest.mark.parametrize("plant", PLANTS)
def test_left_equals_right_where_the_bristle_is_straight(plant):
    drive = PLANTS[plant]
    linear = linearize(drive)
    s0, s1, s2, J = (float(value) for value in (*_stiffness_and_damping(drive), drive.J))
    expected = [[0.0, 1.0, 0.0], [0.0, -(s1 + s2) / J, -s0 / J], [0.0, 1.0, 0.0]]
    np.testing.assert_allclose(linear.left, expected, rtol=1e-13)
    np.testing.assert_allclose(linear.right, expected, rtol=1e-13)
    assert bool(linear.unique)
    assert float(linear.stiffness) == pytest.approx(s0, rel=1e-13)
    assert float(linear.damping) == pytest.approx(s1 + s2, rel=1e-13)


def _stiffness_and_damping(drive):
    return drive.friction.sigma0, drive.friction.sigma1, drive.friction.sigma2


def test_left_differs_from_right_where_the_bristle_is_bent():
    z, friction = 0.4 * float(TABLE_I.friction.Fs / TABLE_I.friction.sigma0), TABLE_I.friction
    linear = linearize(TABLE_I, z=z)
    assert not bool(linear.unique)
    # dz/dt = v - |v| sigma0 z/Fs: on the right the bristle takes 1 - 0.4 of the velocity, on the left 1 + 0.4.
    assert float(linear.right[2, 1]) == pytest.approx(0.6, rel=1e-13)
    assert float(linear.left[2, 1]) == pytest.approx(1.4, rel=1e-13)
    damping = -float(linear.right[1, 1] - linear.left[1, 1])
    assert damping == pytest.approx(-0.8 * float(friction.sigma1), rel=1e-12)
    # The middle of the generalized Jacobian is the matrix of the straight bristle.
    np.testing.assert_allclose(0.5 * (linear.left + linear.right), linearize(TABLE_I).right, atol=1e-9)


# No creep: linearisation holds the states of slow effects, differences of the whole force do not.
STRONG = {
    "ConstantLoad": 0.05,
    "Delay": 1e-4,
    "DirectionAsymmetry": 0.1,
    "ViscousAsymmetry": 0.2,
    "DriveLag": 1e-4,
    "FewElements": 0.4,
    "MaxwellSlip": 0.4,
    "NonlinearBristle": 0.3,
    "PositionDependence": 0.1,
    "PeriodicPositionDependence": -0.1,
    "ReturnSpring": 300.0,
    "Ripple": 0.02,
    "RippleWithOvertones": 0.02,
    "StribeckShape": -0.5,
    "ElastoPlastic": 0.6,
    "SharpYield": 0.4,
    "MicroDamping": 0.5,
    "GravityPendulum": 0.1,
    "LorentzianStribeck": 0.4,
    "QuadraticDrag": 1e3,
    "CubicDrag": 1e5,
    "TorqueRipple": 0.2,
    "TorqueRippleWithOvertone": 0.2,
    "LoadDependence": 0.2,
}


@eqx.filter_jit
def _friction(drive, x, v, z):
    return drive.friction_force(drive.bristles(), x, v, z, jnp.asarray(1e-9))


@pytest.mark.parametrize("plant", ["base", "every effect"])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_each_side_agrees_with_one_sided_differences(plant, side):
    strong = [STRONG.get(form, 0.0) for form, _ in STRENGTHS]
    drive = TABLE_I if plant == "base" else with_every_effect(TABLE_I, strong, but=LOADS)
    n = drive.bristle_count
    x, z = 3e-5, 0.4 * 1.5e-5 * np.asarray(drive.bristles().slack)
    linear = linearize(drive, x=x, z=jnp.asarray(z))

    def field(state):
        force, rate = _friction(drive, *(jnp.asarray(part) for part in (state[0], state[1], state[2:])))
        return np.concatenate([[state[1], -float(force / drive.J)], rate])

    rest = np.concatenate([[x, 0.0], z])
    jacobian = linear.right if side > 0 else linear.left
    step = side * 1e-9  # in v: far below vs, on one side of rest
    at_rest, moved = field(rest), field(rest + step * (np.arange(2 + n) == 1))
    np.testing.assert_allclose((moved - at_rest) / step, jacobian[:, 1], rtol=1e-5, atol=1e-5)
    for column in [0, 2, 1 + n]:
        delta = 1e-9 * (np.arange(2 + n) == column)
        difference = (field(rest + delta) - field(rest - delta)) / 2e-9
        np.testing.assert_allclose(difference, jacobian[:, column], rtol=1e-5, atol=1e-3)


def test_effects_that_act_as_springs_add_to_the_stiffness():
    spring = linearize(ROTARY.with_effects(effect("ReturnSpring", stiffness=500.0)))
    assert float(spring.stiffness) == pytest.approx(2500.0, rel=1e-12)
    bank = linearize(ROTARY.with_effects(effect("MaxwellSlip", share=0.7)))
    assert float(bank.stiffness) == pytest.approx(2000.0, rel=1e-12)
    assert float(bank.damping) == pytest.approx(6.06, rel=1e-12)


def test_float32_is_refused_with_the_cure():
    code = """
from frictionjax.physics import Drive, LuGre, linearize
from frictionjax.simulation import simulate, simulate_reference
drive = Drive(1.0, LuGre(1e5, 316.0, 0.4, 1.0, 1.5, 1e-3))
from frictionjax.core import PrecisionError
for verb in (linearize, lambda d: simulate(d, [0.0], 1e3), lambda d: simulate_reference(d, [0.0], 1e3)):
    try:
        verb(drive)
    except PrecisionError as error:
        assert "jax_enable_x64" in str(error)
        print("refused")
"""
    environment = {"PATH": "", "JAX_ENABLE_X64": "0", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, env=environment
    )
    assert done.stdout.split() == ["refused"] * 3, done.stderr
