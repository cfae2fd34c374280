"""Numbers and units as the report writes them."""

import math

import pytest

from frictionjax.core import Estimate
from frictionjax.report.format import (
    engineering,
    estimate_text,
    number,
    p_equals,
    p_value,
    percent,
    quantities,
    quantity,
    unit_text,
)


@pytest.mark.parametrize(
    ("unit", "shown"),
    [("kg*m^2", "kg·m²"), ("1", ""), ("s^-1", "s⁻¹"), ("N*m*s/rad", "N·m·s/rad"), ("mm", "mm")],
)
def test_units(unit, shown):
    assert unit_text(unit) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (1234.6, "1235"),
        (0.012345, "0.0123"),
        (-3.0, "−3.00"),
        (9.996, "10.0"),
        (1e-12, "10⁻¹²"),
        (2.5e7, "2.5×10⁷"),
        (math.nan, "–"),
        (math.inf, "–"),
    ],
)
def test_numbers(value, shown):
    assert number(value) == shown


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (1.5e-7, "rad", "150 nrad"),
        (0.002, "m", "2.00 mm"),
        (1.0, "m", "1.00 m"),
        (1500.0, "N", "1.50 kN"),
        (2500.0, "m", "2500 m"),
        (3e-6, "mm", "3.00×10⁻⁶ mm"),
        (0.42, "1", "0.420"),
        (0.0, "rad", "0 rad"),
        (math.inf, "rad", "–"),
    ],
)
def test_quantities(value, unit, shown):
    assert quantity(value, unit) == shown


def test_numbers_to_compare_share_a_prefix():
    assert quantities([1.22e-6, 1.2e-7, math.nan], "rad") == ["1.22 µrad", "0.120 µrad", "–"]


@pytest.mark.parametrize("size", [1e-15, 3.7e-8, 0.999999, 1.0, 1000.0, 4e7])
def test_a_prefix_keeps_the_number(size):
    factor, label = engineering("V", size)
    back = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}[label.removesuffix("V")]
    assert size * factor * back == pytest.approx(size)


@pytest.mark.parametrize(
    ("value", "stderr", "shown"),
    [
        (0.026, 1e-5, "0.026000 ± 0.000010"),
        (1814.0, 1.9, "1814.0 ± 1.9"),
        (2.1e-7, 3e-9, "(2.100 ± 0.030)×10⁻⁷"),
        (3.5e8, 2e5, "(3.5000 ± 0.0020)×10⁸"),
        (12.0, 340.0, "12 ± 340"),
        (0.4, math.inf, "0.400"),
        (0.4, 0.0, "0.400"),
    ],
)
def test_a_value_has_the_digits_of_its_error(value, stderr, shown):
    assert estimate_text(Estimate(value, stderr, "1")) == shown


def test_shares_and_p_values():
    assert [percent(share) for share in (0.83, 0.004, 0.0, -0.02, math.nan)] == [
        "83 %",
        "0.4 %",
        "0 %",
        "−2 %",
        "–",
    ]
    assert [p_value(p) for p in (0.3, 1e-12, 0.0, math.nan)] == ["0.30", "10⁻¹²", "< 10⁻³⁰⁰", "–"]
    assert [p_equals(p) for p in (0.3, 0.0, math.nan)] == ["p = 0.30", "p < 10⁻³⁰⁰", "p –"]
