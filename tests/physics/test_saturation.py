"""Saturation of the drive: soft and hard, and what its derivatives are where it does nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import effect

DT = jnp.asarray(1e-3)
U = jnp.asarray([-1.0, -0.3, -0.01, 0.0, 1e-3, 0.2, 0.7, 1.0])


@pytest.mark.parametrize("sharpness", [1.0, 2.0, 3.7])
def test_soft_saturation_comes_near_its_limit(sharpness):
    """At the limit the gain has fallen to 2^(-1/sharpness), far above it the limit acts; at zero nothing is lost."""
    limit = 0.4
    cut = 1.0 - (1.0 + (2.0 / limit) ** sharpness) ** (-1.0 / sharpness)
    made = effect("SoftSaturation", cut=cut, sharpness=sharpness, largest=2.0)
    np.testing.assert_allclose(made.apply(jnp.asarray([2.0]), DT), 2.0 * (1.0 - cut), rtol=1e-12)
    gain = made.apply(jnp.asarray([1e-9, limit, 1e7]), DT) / jnp.asarray([1e-9, limit, 1e7])
    np.testing.assert_allclose(gain, [1.0, 2.0 ** (-1.0 / sharpness), limit / 1e7], rtol=1e-6)
    np.testing.assert_array_equal(made.silenced().apply(U, DT), U)


def test_soft_saturation_has_derivatives_where_nothing_is_applied():
    """By all parameters and by the input, at zero input and where nothing is cut off."""
    form = effect("SoftSaturation")
    slope = jax.jacfwd(lambda p: type(form)(*p).apply(jnp.asarray([0.0, 1.0, -1.0]), DT))
    at_rest, at_work = slope((0.0, 2.0, 1.0)), slope((0.5, 2.0, 1.0))
    assert all(np.all(np.isfinite(one)) for one in (*at_rest, *at_work))
    np.testing.assert_allclose(at_rest[0], [0.0, -1.0, 1.0], rtol=1e-12)
    np.testing.assert_array_equal(at_rest[1], 0.0)


def test_hard_saturation_cuts_at_its_limit_and_at_zero_nothing():
    made = effect("HardSaturation", cut=0.5, largest=1.0)
    np.testing.assert_allclose(made.apply(U, DT), np.clip(U, -0.5, 0.5))
    none = effect("HardSaturation", largest=0.5)
    np.testing.assert_array_equal(none.apply(U, DT), U)
