"""Recordings as people bring them (where they are at hand), diagnosed: the right answer of each, from its own note."""

import warnings
from pathlib import Path

import pytest

from frictionjax.core import FrictionjaxWarning
from frictionjax.diagnosis import diagnose

pytestmark = pytest.mark.slow

FIELD = Path(__file__).parents[3] / "shared" / "field"
GRAVITY = {"i1b_gravity_only": 11.0, "i1c_gravity_weaker": 2.0, "i1d_gravity_middle": 5.0}
"""Torque of gravity of a joint, N m, by simulators of other people."""


@pytest.fixture
def found(request):
    """The diagnosis of a field case."""
    case = FIELD / request.param / "case.toml"
    if not case.exists():
        pytest.skip("the field recordings are not here")
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", FrictionjaxWarning
        )  # of how the files were read: `tests/recordings/test_field.py`
        return diagnose(case, progress=False)


@pytest.mark.parametrize("found", GRAVITY, indirect=True)
def test_gravity_is_named_with_its_size_and_the_inertia(found, request):
    (only,) = found.missing
    assert found.verdict == "named" and only.effect_class == ("gravity_pendulum",)
    size = only.parameters["sine"]
    # The simulator integrates by other steps: a part in five hundred is not chance.
    assert size.value == pytest.approx(GRAVITY[request.node.callspec.params["found"]], rel=2e-3)
    assert found.extended["J"].value == pytest.approx(0.35, rel=0.01)


@pytest.mark.parametrize("found", ["n1_ripple_delay"], indirect=True)
def test_cogging_and_a_delay_are_named_and_no_lag_in_place_of_the_delay(found):
    assert found.verdict == "named"
    assert [one.effect for one in found.missing] == ["ripple", "delay"]
    ripple, delay = found.missing
    assert set(delay.effect_class) <= {"delay", "drive_lag"}
    assert delay.parameters["delay"].value == pytest.approx(2e-3, rel=0.03)
    assert ripple.parameters["period"].value == pytest.approx(0.2244, rel=1e-3)
    sine, cosine = (ripple.parameters[name].value for name in ("sine", "cosine"))
    assert (sine**2 + cosine**2) ** 0.5 == pytest.approx(0.03, rel=0.01)


@pytest.mark.parametrize("found", ["i4_sign_flip"], indirect=True)
def test_a_reversed_sensor_is_the_first_thing_that_is_said(found):
    assert not found.missing
    assert found.summary.startswith("Set scale = {u = -1.0}")


@pytest.mark.parametrize("found", ["i8_plc_scope"], indirect=True)
def test_a_machine_with_nothing_missing_is_adequate(found):
    assert found.verdict == "adequate" and not found.missing


@pytest.mark.parametrize("found", ["r3_bldc_sine"], indirect=True)
def test_a_motor_whose_law_is_in_no_catalogue_is_unknown(found):
    assert found.verdict == "unknown"
    assert any("none is missing" in text for text in found.warnings)
