"""The force balance: gravity, a spring or a load that carries most of the force is found, at any size.

The motion is given and the input follows from it exactly, so that what the balance must find is known.
"""

from pathlib import Path

import numpy as np
import pytest

from frictionjax.estimation import starting_values
from frictionjax.estimation.start.force_balance import force_balance, linear_forces
from frictionjax.physics.effects import catalogue
from frictionjax.recordings import Recording, load_case

RATE, J, FC = 1000.0, 0.05, 0.4
FIELD = Path(__file__).parents[4] / "shared" / "field"


def swing(force, *, rate=RATE, size=1.0):
    """A motion to and fro, and the input that makes it against inertia, friction and `force(x, v)`."""
    t = np.arange(round(12.0 * rate)) / rate
    x = size * (np.sin(2.0 * t) + 0.3 * np.sin(7.0 * t))
    v = size * (2.0 * np.cos(2.0 * t) + 2.1 * np.cos(7.0 * t))
    a = -size * (4.0 * np.sin(2.0 * t) + 14.7 * np.sin(7.0 * t))
    return Recording("swing", rate, J * a + FC * np.sign(v) + force(x, v), x, loop="closed")


def balance(recording, **choices):
    return force_balance((recording,), starting_values((recording,)).drives, **choices)


@pytest.mark.parametrize("rate", [62.5, 200.0, 1000.0])
@pytest.mark.parametrize("times", [3.0, 30.0, 100.0], ids=lambda times: f"{times:g} Fc")
def test_gravity_is_found_at_any_size_and_rate(rate, times):
    sine = times * FC
    first = balance(swing(lambda x, v: sine * np.sin(x), rate=rate))[0]
    assert first.effect.name == "gravity_pendulum"
    assert float(first.effect.sine) == pytest.approx(sine, rel=0.02)
    assert abs(float(first.effect.cosine)) < 0.05 * sine
    for drive in first.drives:
        # At 100 times the inertia is a fiftieth of the force, less than the smoothing leaves at 62.5 Hz.
        assert float(drive.J) > 0.0
        if times < 50.0:
            assert float(drive.J) == pytest.approx(J, rel=0.1)
        assert float(drive.friction.Fs) > float(drive.friction.Fc) > 0.0


def test_friction_and_stiffness_start_where_the_balance_says():
    recording = swing(lambda x, v: 8.0 * np.sin(x))
    starts = starting_values((recording,)).drives
    first = balance(recording)[0]
    assert len(first.drives) == len(starts)
    for drive, start in zip(first.drives, starts, strict=True):
        assert float(drive.friction.Fc) == pytest.approx(FC, rel=0.1)
        bend = [float(one.friction.Fs / one.friction.sigma0) for one in (drive, start)]
        assert bend[0] == pytest.approx(bend[1], rel=1e-9)


def test_a_spring_and_a_load_are_found():
    spring = balance(swing(lambda x, v: 6.0 * x, size=0.1))
    assert {one.effect.name for one in spring[:2]} >= {"return_spring"}
    stiffness = next(one for one in spring if one.effect.name == "return_spring").effect.stiffness
    assert float(stiffness) == pytest.approx(6.0, rel=0.02)
    (load,) = balance(swing(lambda x, v: 3.0 + 0.0 * x), without=frozenset({"gravity_pendulum"}))
    assert load.effect.name == "constant_load"
    assert float(load.effect.load) == pytest.approx(3.0, rel=0.02)


def test_a_pendulum_that_swings_a_little_is_no_constant_load():
    """Its torque hardly varies: beside a constant force gravity says little, and alone all."""
    first, second = balance(
        swing(lambda x, v: 3.0 * np.cos(x), size=0.12), without=frozenset({"return_spring"})
    )
    assert first.effect.name == "gravity_pendulum" and second.effect.name == "constant_load"
    assert float(first.effect.cosine) == pytest.approx(3.0, rel=0.02)
    assert abs(float(first.effect.sine)) < 0.1
    assert first.unexplained < 0.5 * second.unexplained


def test_a_machine_without_any_asks_for_none():
    assert balance(swing(lambda x, v: 0.02 * v)) == ()


def test_what_is_left_out_is_not_asked_for():
    recording = swing(lambda x, v: 8.0 * np.sin(x))
    assert "gravity_pendulum" not in {
        one.effect.name for one in balance(recording, without=frozenset({"gravity_pendulum"}))
    }


def test_a_known_inertia_stays():
    first = balance(swing(lambda x, v: 8.0 * np.sin(x)), inertia=J)[0]
    assert all(float(drive.J) == J for drive in first.drives)


def test_the_forces_are_those_of_the_catalogue_that_are_linear():
    names = {type(form).__name__ for form in linear_forces()}
    assert {"ConstantLoad", "ReturnSpring", "GravityPendulum", "QuadraticDrag"} <= names
    forms = {form.__name__ for own in catalogue().values() for form in own}
    assert names < forms
    # Their place depends on a period, or they have a memory.
    assert not names & {"Ripple", "Viscoelastic", "DwellStrengthening"}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "sine"), [("i1b_gravity_only", 11.0), ("i1c_gravity_weaker", 2.0)])
def test_a_joint_under_gravity_is_diagnosed(name, sine):
    from frictionjax.diagnosis import diagnose

    file = FIELD / name / "case.toml"
    if not file.exists():
        pytest.skip("the field recordings are not here")
    found = diagnose(load_case(file))
    assert (found.verdict, [m.effect for m in found.missing]) == ("named", ["gravity_pendulum"])
    assert found.extended["sine"].value == pytest.approx(sine, rel=0.01)
    assert found.extended["J"].value == pytest.approx(0.35, rel=0.02)
