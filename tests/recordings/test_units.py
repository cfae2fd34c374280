"""Units: what a header says, its factor to SI, and what is no unit."""

import math

import pytest

from frictionjax.recordings.units import is_unit, parse_unit, split_unit


@pytest.mark.parametrize(
    ("text", "factor", "si"),
    [
        ("ms", 1e-3, "s"),
        ("µs", 1e-6, "s"),
        ("h", 3600.0, "s"),
        ("deg", math.pi / 180, "rad"),
        ("°", math.pi / 180, "rad"),
        ("turn/4096", 2 * math.pi / 4096, "rad"),
        ("rpm", 2 * math.pi / 60, "rad/s"),
        ("RPM", 2 * math.pi / 60, "rad/s"),
        ("mm/s", 1e-3, "m/s"),
        ("mA", 1e-3, "A"),
        ("Nmm", 1e-3, "N*m"),
        ("mN·m", 1e-3, "N*m"),
        ("N m", 1.0, "N*m"),
        ("kN", 1e3, "N"),
        ("N*m/A", 1.0, "N*m/A"),
    ],
)
def test_a_unit_has_a_factor_to_si(text, factor, si):
    unit = parse_unit(text)
    assert unit is not None
    assert unit.factor == pytest.approx(factor, rel=1e-14)
    assert unit.si == si


@pytest.mark.parametrize(
    "text", ["", "counts", "%", "x", "3", "rad/rad", "mrpm", "deg/", "N*", "0*m", "0.1 %"]
)
def test_other_texts_are_no_unit_with_a_factor(text):
    assert parse_unit(text) is None


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("x [deg]", "x", "deg"),
        ("Position (mm)", "Position", "mm"),
        ("t/ms", "t", "ms"),
        ("speed in rpm", "speed", "rpm"),
        ("time_ms", "time", "ms"),
        ("I [A]", "I", "A"),
        ("x [counts]", "x", "counts"),
        # No units: a motor's position, an input, a least value, a remark.
        ("x_m", "x_m", ""),
        ("u_in", "u_in", ""),
        ("x_min", "x_min", ""),
        ("Position (motor)", "Position (motor)", ""),
        ("a/b", "a/b", ""),
    ],
)
def test_the_unit_in_a_header(header, name, unit):
    assert split_unit(header) == (name, unit)


def test_a_cell_of_a_line_of_units():
    assert all(map(is_unit, ("s", "[mm]", "(V)", "%", "counts")))
    assert not any(map(is_unit, ("REAL64", "", "Angle", "1.5")))
