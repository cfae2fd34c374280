"""`simulate_imposed`: effects inside the friction law, beside it and off the way, against scipy and closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_imposed import MOTION, differences, reference, sine, worst
from helpers_plants import (
    FORMS,
    LOADS,
    SENSORS,
    STATES,
    STRENGTHS,
    TABLE_I,
    effect,
    some_slow,
    with_every_effect,
)

from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate_imposed
from frictionjax.simulation.imposed import imposed_friction


def _needle(v):
    return np.exp(-((v / 1e-3) ** 2))


def _core(bend, direction):
    way = np.clip((abs(bend) - 0.5) / 0.5, 0.0, 1.0)
    return bend * 0.5 * (1.0 - np.cos(np.pi * way)) if bend * direction > 0.0 else 0.0


EFFECTS = {
    "DirectionAsymmetry": ({"coulomb": 0.15}, {"shape": lambda x, v: 1.0 + 0.15 * np.sign(v)}),
    "PositionDependence": (
        {"linear": 0.3, "quadratic": -0.2},
        {"shape": lambda x, v: 1.0 + 0.3 * (x / 1e-3 - 0.1) - 0.2 * (1.5 * (x / 1e-3 - 0.1) ** 2 - 0.5)},
    ),
    "NonlinearBristle": ({"hardening": 0.8}, {"hardening": 0.8}),
    "Creep": ({"compliance": 0.4, "time_constant": 0.05}, {"creep": (0.4, 0.05)}),
    "CreepingSlip": (
        {"compliance": 0.4, "time_constant": 0.05},
        {"creep": (0.4, 0.05), "slips_with": "v"},
    ),
    "StribeckShape": (
        {"exponent_change": -1.0},
        {
            "shape": lambda x, v: (
                (1.0 + 0.5 * np.exp(-abs(v / 1e-3))) / (1.0 + 0.5 * np.exp(-(abs(v / 1e-3) ** 2)))
            )
        },
    ),
}


EFFECTS |= {
    "FrictionLag": (
        {"lag": 0.02},
        {
            "state": (
                0.0,
                lambda v, w, bend: (v - w) / 0.02,
                lambda v, w, G: G + 0.5 * (_needle(w) - _needle(v)),
            )
        },
    ),
    "DwellStrengthening": (
        {"growth": 0.1, "onset": 0.01, "length": 1e-5},
        {
            "state": (
                1.0,
                lambda v, age, bend: 1.0 - abs(v) * min(abs(bend), 1.0) * age / 1e-5,
                lambda v, age, G: G + 0.1 * np.log1p(age / 0.01),
            )
        },
    ),
    "SaturatingStrengthening": (
        {"growth": 0.5, "time": 0.02},
        {
            "state": (
                1.0,
                lambda v, age, bend: 1.0 - abs(v) * min(abs(bend), 1.0) * age / 1.5e-5,
                lambda v, age, G: G + 0.5 * (1.0 - np.exp(-age / 0.02)),
            )
        },
    ),
    "WarmupByTime": (
        {"fall": 0.4, "time_constant": 1.0},
        {"state": (0.0, lambda v, T, bend: 1.0 - T, lambda v, T, G: G * (1.0 - 0.4 * T))},
    ),
    "WarmupByHeat": (
        {"fall": 0.5, "time_constant": 1.0, "distance": 1e-4},
        {"state": (0.0, lambda v, T, bend: abs(v) / 1e-4 - T, lambda v, T, G: G * max(1.0 - 0.5 * T, 0.1))},
    ),
    "SharpYield": ({"exponent_change": 1.0}, {"slip": lambda bend, direction: bend * abs(bend)}),
    "ElastoPlastic": ({"plasticity": 1.0, "core": 0.5}, {"slip": _core}),
}
"""Strengths and nuisances of ours, and the same for `reference`."""


FORCES = {
    "ConstantLoad": ({"load": 0.3}, lambda x, v: 0.3),
    "ReturnSpring": ({"stiffness": 50.0}, lambda x, v: 50.0 * x),
    "ViscousAsymmetry": ({"viscous": 0.2}, lambda x, v: 0.08 * np.abs(v)),
    "Ripple": (
        {"sine": 0.1, "cosine": 0.2},
        lambda x, v: 0.1 * np.sin(x * 5e3 * np.pi) + 0.2 * np.cos(x * 5e3 * np.pi),
    ),
    "QuadraticDrag": ({"drag": 1e4}, lambda x, v: 1e4 * v * np.abs(v)),
    "CubicDrag": ({"drag": 1e7}, lambda x, v: 1e7 * v**3),
    "GravityPendulum": ({"sine": 50.0, "cosine": 0.2}, lambda x, v: 50.0 * np.sin(x) + 0.2 * np.cos(x)),
}
"""Strengths of what is a force beside the law, and the force."""

T = np.arange(2001) / 2000.0
JOINT = [form for form in (*EFFECTS, *FORCES) if form not in STATES]
"""Forms without states of their own: one drive has them all, of strengths zero but for one, and is one program."""


def _with(form, strengths):
    """The plant of Table I with `form`, and with those of JOINT that do nothing if it is one of them."""
    if form not in JOINT:
        return TABLE_I.with_effects(effect(form, **strengths))
    return TABLE_I.with_effects(*(effect(name, **(strengths if name == form else {})) for name in JOINT))


@pytest.mark.parametrize("form", EFFECTS)
@pytest.mark.parametrize("stroke", [1.5e-5, 2e-4])
def test_an_effect_inside_the_law_is_that_of_scipy(form, stroke):
    ours, theirs = EFFECTS[form]
    motion, _ = sine(stroke, 2.0)
    exact, _ = reference(TABLE_I, motion, T, **theirs)
    found = worst(simulate_imposed(_with(form, ours), motion(T)[0], 2000.0).friction, exact, 1.5)
    # An elastic core ends within a few samples: 5.3e-4, and a quarter of that at twice the rate.
    assert found < (1e-3 if form == "ElastoPlastic" else 3e-4)
    base = worst(simulate_imposed(TABLE_I, motion(T)[0], 2000.0).friction, exact, 1.5)
    # A lag of the velocity is next to nothing below it.
    assert base > (5e-4 if form == "FrictionLag" else 1e-2)
    assert base > 10.0 * found


@pytest.mark.parametrize("stroke", [1.5e-5, 2e-4])
def test_maxwell_slip_is_a_bank_of_plays(stroke):
    """The plays followed on a grid 50 times finer; without bristle damping, which is a mean over a sample."""
    drive = Drive(1.0, LuGre(1e5, 0.0, 0.4, 1.0, 1.5, 1e-3), effects=(effect("MaxwellSlip", share=0.6),))
    motion, _ = sine(stroke, 2.0)
    fine = np.arange(100_001) / 100_000.0
    count = FORMS["MaxwellSlip"].count
    slack = np.exp(1.5 * (2.0 * (np.arange(count) + 0.5) / count - 1.0))
    x, v = motion(fine)
    limit = np.outer((1.0 + 0.5 * np.exp(-((v / 1e-3) ** 2))) / 1e5, slack / np.mean(slack))
    plays, played = np.zeros(count), [np.zeros(count)]
    for way, most in zip(np.diff(x), limit[1:], strict=True):
        plays = np.clip(plays + way, -most, most)
        played.append(plays)
    bristle, _ = reference(drive, motion, T)
    exact = 0.4 * bristle + 0.6 * (1e5 * np.mean(played, axis=1)[::50] + 0.4 * motion(T)[1])
    run = simulate_imposed(drive, motion(T)[0], 2000.0)
    assert run.z.shape == (2001, count + 1)
    assert worst(run.friction, exact, 1.5) < 5e-4


@pytest.mark.parametrize(
    "form", some_slow(FORMS, ("ConstantLoad", "Creep", "DwellStrengthening", "MaxwellSlip"))
)
def test_every_effect_of_zero_strength_runs_and_changes_nothing(form):
    motion, _ = sine(2e-4, 2.0)
    base = simulate_imposed(TABLE_I, motion(T)[0], 2000.0)
    none = simulate_imposed(TABLE_I.with_effects(effect(form)), motion(T)[0], 2000.0)
    np.testing.assert_allclose(none.friction, base.friction, atol=2e-14)


def test_together_effects_of_zero_strength_change_nothing():
    motion, _ = sine(2e-4, 2.0)
    base = simulate_imposed(TABLE_I, motion(T)[0], 2000.0)
    none = simulate_imposed(_with(JOINT[0], {}), motion(T)[0], 2000.0)
    np.testing.assert_allclose(none.friction, base.friction, atol=2e-14)


@pytest.mark.parametrize("form", FORCES)
def test_an_effect_beside_the_law_adds_its_force(form):
    strengths, force = FORCES[form]
    motion, _ = sine(2e-4, 2.0)
    base = simulate_imposed(TABLE_I, motion(T)[0], 2000.0)
    run = simulate_imposed(_with(form, strengths), motion(T)[0], 2000.0)
    # Where two sides of a sample are averaged, a square is not that of the mean: at both ends.
    rtol = 2e-5 if form.endswith("Drag") else 1e-7
    np.testing.assert_allclose(run.friction - base.friction, force(run.x, run.v), rtol=rtol, atol=1e-7)


BESIDE = [
    *("Delay", "DriveLag", "DriveDeadzone", "SoftSaturation", "HardSaturation"),
    *("LoadDependence", "TorqueRipple", "TorqueRippleWithOvertone"),
    *SENSORS,
    *LOADS,
]
"""Forms on the input, the motor force, the sensor, or behind a coupling."""


def test_what_is_beside_the_way_does_not_act():
    x = 1e-4 * np.sin(0.1 * np.arange(300))
    others = [effect(form, **{s.name: 0.1 for s in FORMS[form].strengths}) for form in BESIDE]
    np.testing.assert_array_equal(
        simulate_imposed(TABLE_I.with_effects(*others), x, 500.0).friction,
        simulate_imposed(TABLE_I, x, 500.0).friction,
    )


UNITS = np.array([{"QuadraticDrag": 1e3, "CubicDrag": 1e5}.get(form, 0.02) for form, _ in STRENGTHS])


@eqx.filter_jit
def _by_strengths(relative, x, but):
    drive = with_every_effect(TABLE_I, relative * UNITS, but=but)
    return imposed_friction(drive, x, 1.0 / 300.0, 1e-6)


_slopes = eqx.filter_jit(lambda relative, x, but: jax.jacfwd(lambda r: _by_strengths(r, x, but))(relative))

SIMPLE, ALL = (*BESIDE, *STATES), tuple(BESIDE)
"""What is left out: the effects with states of their own, or none that acts."""
each_set = pytest.mark.parametrize(
    "but", [pytest.param(SIMPLE, id="without states"), pytest.param(ALL, id="all", marks=pytest.mark.slow)]
)


@each_set
def test_derivatives_by_every_strength(but):
    ones = np.ones(len(STRENGTHS))
    forward = np.asarray(_slopes(ones, MOTION, but))
    central = differences(lambda relative: _by_strengths(relative, MOTION, but), ones, 5e-3)
    # A sample at which a play begins to slip, between two points of the difference, is a corner: one in a hundred.
    apart = np.quantile(np.abs(forward - central), 0.97, axis=0)
    for name, error, ours, theirs in zip(STRENGTHS, apart, forward.T, central.T, strict=True):
        assert error <= 1e-6 * np.max(np.abs(theirs)), name
        assert np.any(ours) == (name[0] not in but), name


@each_set
def test_derivatives_at_rest_are_finite(but):
    slopes = _slopes(np.zeros(len(STRENGTHS)), np.zeros(301), but)
    assert bool(jnp.all(jnp.isfinite(slopes)))
