"""Fig. 2 and the linearisation, against closed forms that the code under test does not hold."""

import math

import numpy as np
import pytest
from helpers_plants import ROTARY, TABLE_I, effect

from frictionjax.core import InputError
from frictionjax.paper.experiments import linearised, presliding
from frictionjax.paper.experiments.presliding import slow_position
from frictionjax.studies.level_sweep import table_one


@pytest.fixture(scope="module")
def loops():
    """The cycle of Fig. 2 in 160 s and in 320 s: slow enough for what is left to be of the first order in the rate."""
    return tuple(presliding(seconds=seconds, sample_rate=250.0) for seconds in (160.0, 320.0))


def test_table_one_is_that_of_the_tests():
    assert float(table_one().friction.sigma0) == float(TABLE_I.friction.sigma0)
    assert linearised().stiffness == linearised(TABLE_I).stiffness


def test_virgin_curve_tends_to_its_closed_form_as_the_ramp_slows(loops):
    fast, slow = loops
    assert slow.virgin_expected == pytest.approx(44.936e-6, abs=5e-10)
    assert abs(slow.virgin - 44.936e-6) < abs(fast.virgin - 44.936e-6) < 2e-3 * 44.936e-6
    # Extrapolated to no rate at all, what is left is gone.
    assert 2.0 * slow.virgin - fast.virgin == pytest.approx(44.936e-6, rel=1e-4)


def test_virgin_curve_and_branch_point_by_point(loops):
    Fs, sigma0, Fm = 1.5, 1e5, 0.95 * 1.5
    errors = []
    for loop in loops:
        n = (loop.t.size - 1) // 8
        virgin, up = slice(0, n), slice(3 * n, 5 * n)
        # F = Fs (1 - exp(-sigma0 x / Fs)), and after the reversal at (xm, -Fm) F = Fs - (Fs + Fm) exp(...), for x.
        expected = -Fs / sigma0 * np.log(1.0 - loop.u[virgin] / Fs)
        xm = Fs / sigma0 * (math.log(20.0) - math.log(1.95 / 0.05))
        branch = xm - Fs / sigma0 * np.log((Fs - loop.u[up]) / (Fs + Fm))
        errors.append([np.max(np.abs(loop.x[virgin] - expected)), np.max(np.abs(loop.x[up] - branch))])
    assert np.all(np.array(errors[1]) < 1.2e-7)  # of 45 µm
    np.testing.assert_allclose(np.array(errors[0]) / errors[1], 2.0, atol=0.15)


def test_nothing_stays_after_a_cycle(loops):
    fast, slow = loops
    for name in ("x_after_cycle", "z_after_cycle"):
        left = [getattr(loop, name) for loop in (fast, slow)]
        # What sigma1 holds back is proportional to the rate, and that is all there is.
        assert abs(left[1]) < 2e-8
        assert left[0] / left[1] == pytest.approx(2.0, rel=0.02)
    # The second cycle repeats the first.
    n = (slow.t.size - 1) // 8
    np.testing.assert_allclose(slow.x[5 * n : 7 * n], slow.x[n : 3 * n], atol=2e-8)


def test_the_closed_form_closes_its_loop_and_stands_without_simulation():
    up = np.linspace(0.0, 1.425, 400)
    force = np.concatenate([up, np.linspace(1.425, -1.425, 800)[1:], np.linspace(-1.425, 0.0, 400)[1:]])
    x = slow_position(force, 1.5, 1e5)
    assert x[399] == pytest.approx(1.5e-5 * math.log(20.0), rel=1e-12)
    assert x[-1] == pytest.approx(0.0, abs=1e-18)
    assert x.max() - x.min() == pytest.approx(1.5e-5 * math.log(1.95 / 0.05), rel=1e-12)


def test_effects_are_refused():
    with pytest.raises(InputError, match=r"`drive` has effects.*Leave `with_effects` out"):
        presliding(TABLE_I.with_effects(effect("ReturnSpring", stiffness=10.0)))


def test_linearised_table_one():
    found = linearised(points=5)
    assert found.natural_frequency == pytest.approx(50.329, abs=5e-4)
    assert found.damping_ratio == pytest.approx(0.50063, abs=5e-6)
    assert found.unique_at_rest
    middle = 2
    assert found.stiffness_left[middle] == found.stiffness_right[middle] == pytest.approx(1e5)


@pytest.mark.parametrize("drive", [TABLE_I, ROTARY], ids=["table I", "rotary"])
def test_the_hull_has_two_ends_where_the_bristle_is_bent(drive):
    found = linearised(drive, points=5)
    sigma0, sigma1, sigma2 = (float(getattr(drive.friction, n)) for n in ("sigma0", "sigma1", "sigma2"))
    # dz/dt = v (1 - sign(v) b) with b the deflection over Fs / sigma0: to the right a bristle bent to the right slips.
    np.testing.assert_allclose(found.bend, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(found.stiffness_right, sigma0 * (1.0 - found.bend), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.stiffness_left, sigma0 * (1.0 + found.bend), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.damping_right, sigma1 * (1.0 - found.bend) + sigma2, rtol=1e-9)
    np.testing.assert_allclose(found.damping_left, sigma1 * (1.0 + found.bend) + sigma2, rtol=1e-9)
