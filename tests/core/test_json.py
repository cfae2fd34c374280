"""Results as strict JSON."""

import json
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from frictionjax.core import Estimate
from frictionjax.core.json import plain_json


class Nested(eqx.Module):
    """A Module whose fields are an array, a Module and a dictionary of tuples."""

    x: np.ndarray
    size: Estimate
    parts: dict


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float64("nan"), None),
        (math.inf, None),
        (-0.1, -0.1),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (True, True),
        ("text", "text"),
        (None, None),
        ((1, (2.0, -math.inf)), [1, [2.0, None]]),
        (jnp.ones(2), [1.0, 1.0]),
        (jnp.asarray(2.5), 2.5),
        (np.array([[1.0, np.nan]]), [[1.0, None]]),
        ({1: {"a": (np.float64(0.5),)}}, {"1": {"a": [0.5]}}),
        (
            Estimate(1.0, math.inf, "N"),
            {"value": 1.0, "stderr": None, "unit": "N", "identified": True},
        ),
    ],
)
def test_values_become_plain(value, expected):
    found = plain_json(value)
    assert found == expected
    assert type(found) is type(expected)
    json.dumps(found, allow_nan=False)


def test_modules_are_taken_apart_field_by_field():
    found = plain_json(Nested(np.array([1.0, np.inf]), Estimate(2.0, 0.5, "m"), {"clipped": (1, math.nan)}))
    assert list(found) == ["x", "size", "parts"]
    assert found["x"] == [1.0, None]
    assert found["size"]["stderr"] == 0.5
    assert found["parts"] == {"clipped": [1, None]}


def test_numbers_keep_every_bit():
    value = np.random.default_rng(0).standard_normal(20) * 10.0 ** np.arange(-10, 10)
    assert np.array_equal(np.array(json.loads(json.dumps(plain_json(value)))), value)


def test_what_json_has_no_type_for_is_refused_by_json_and_not_changed_here():
    with pytest.raises(TypeError, match="not JSON serializable"):
        json.dumps(plain_json({"when": {1, 2}}))
