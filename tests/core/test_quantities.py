"""Numbers with units as sentences write them."""

import pytest

from frictionjax.core.quantities import neat, one_two_five, power_of_thousand, prefixed, span


def test_quantities_read_well():
    assert [neat(v, "m") for v in (2e-5, 1.5, 0.0, 3e-10)] == ["20 µm", "1.5 m", "0 m", "300 pm"]
    assert (neat(0.3, "s"), neat(0.01, "s"), neat(123456.0, "V")) == ("0.3 s", "10 ms", "123456 V")
    assert span(0.005, 0.02, "s") == "5 to 20 ms"
    assert span(-0.2, -0.15, "rad") == "-0.2 to -0.15 rad"
    # A short stroke far from zero.
    assert span(-0.109876, -0.109848, "m") == "-0.109876 to -0.109848 m"
    assert neat(-0.109876, "m", 2.8e-5) == "-0.109876 m"
    assert [one_two_five(v) for v in (1.4e-5, 1.5e-5, 8.0)] == pytest.approx([1e-5, 2e-5, 10.0])


@pytest.mark.parametrize(
    ("size", "largest", "label"),
    [(2e-16, 0, "pN"), (1e-6, 0, "µN"), (0.999, 0, "mN"), (1e4, 0, "N"), (1e4, 3, "kN"), (1e7, 3, "kN")],
)
def test_a_prefix_keeps_the_number_and_stays_between_its_ends(size, largest, label):
    factor, unit = prefixed(size, "N", largest)
    assert unit == label
    powers = {"p": -12, "µ": -6, "m": -3, "": 0, "k": 3}
    assert factor == pytest.approx(10.0 ** -powers[label[:-1]])


@pytest.mark.parametrize(("size", "exponent"), [(1.0, 0), (999.0, 0), (1000.0, 3), (1e-3, -3), (9e-4, -6)])
def test_powers_of_a_thousand(size, exponent):
    assert power_of_thousand(size) == exponent
