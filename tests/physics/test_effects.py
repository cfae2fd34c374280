"""The catalogue, and every effect against its closed form in steady sliding."""

import dataclasses
import inspect

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import FORMS, TABLE_I, effect

from frictionjax.physics import catalogue
from frictionjax.physics.effects import (
    AbstractEffect,
    AbstractInputEffect,
    AbstractLoadEffect,
    AbstractSensorEffect,
    AbstractSpringEffect,
)
from frictionjax.simulation import simulate

NAMES = [
    *("backlash", "constant_load", "creep", "delay", "direction_asymmetry", "drive_deadzone", "drive_lag"),
    *("drive_saturation", "dwell_strengthening", "elasto_plastic", "encoder_error", "flexible_transmission"),
    *("friction_lag", "gravity_pendulum", "load_dependence", "mains_pickup", "maxwell_slip", "micro_damping"),
    *("nonlinear_bristle", "position_dependence", "quadratic_drag", "return_spring", "ripple", "sensor_lag"),
    *("stribeck_shape", "torque_ripple", "viscoelastic_damping", "warmup"),
]
NEEDS = {"sliding", "presliding", "rest", "both directions", "clock", "angle", "temperature", "motor force"}


def test_the_catalogue_finds_every_effect():
    assert list(catalogue()) == NAMES
    for name, forms in catalogue().items():
        assert forms
        for form in forms:
            assert form.name == name
            assert issubclass(form, AbstractEffect) and not inspect.isabstract(form)


@pytest.mark.parametrize("name", NAMES)
def test_every_form_says_what_it_is(name):
    for form in catalogue()[name]:
        about = form.about
        assert about.sentence and about.equation and about.shows
        assert bool(about.split_by) or not about.confused_with
        assert set(about.confused_with) <= set(NAMES) - {name}
        assert set(about.needs) <= NEEDS
        stated = [parameter.name for parameter in form.strengths + form.nuisances]
        assert stated == [field.name for field in dataclasses.fields(form) if field.name != "turn"]
        for parameter in form.strengths + form.nuisances:
            assert parameter.unit and parameter.meaning
            assert parameter.lower < parameter.upper
        for parameter in form.nuisances:
            assert parameter.grid
            if parameter.grid != "period" and parameter.scale == 1.0:
                assert all(parameter.lower <= value <= parameter.upper for value in parameter.grid)


@pytest.mark.parametrize("form", FORMS)
def test_strengths_are_zero_unless_given_and_admissible(form):
    default = FORMS[form]()
    for parameter in FORMS[form].strengths:
        assert float(getattr(default, parameter.name)) == 0.0
        assert parameter.transform == "linear"
        assert parameter.lower <= 0.0 < parameter.upper


def test_arguments_of_the_constructors_become_arrays():
    leaves = [leaf for form in FORMS for leaf in jax.tree.leaves(FORMS[form]())]
    assert {leaf.dtype for leaf in leaves} == {jnp.dtype("float64")}


FC, FS, VS, S0, S2 = 1.0, 1.5, 1e-3, 1e5, 0.4
H = jnp.asarray(1e-4)
PUSH = 0.4


def _level(v):
    return FC + (FS - FC) * np.exp(-((v / VS) ** 2))


def _polynomial(x, linear, quadratic):
    p = (x - 1e-4) / 1e-3
    return 1.0 + linear * p + quadratic * (1.5 * p**2 - 0.5)


def _wave(x, sine, cosine, period=4e-4):
    return sine * np.sin(2 * np.pi * x / period) + cosine * np.cos(2 * np.pi * x / period)


def _steady(level=1.0, more=0.0):
    """Force that opposes steady sliding: the level times `level`, the viscous force, and `more` force."""

    def force(x, v):
        factor, rest = (part(x, v) if callable(part) else part for part in (level, more))
        return np.sign(v) * _level(v) * factor + S2 * v + rest

    return force


def _aged(growth, rise):
    """Of an age that sliding holds at 15 um over the speed."""
    return lambda x, v: np.sign(v) * growth * FC * rise(1.5e-5 / abs(v))


SLIDING = {
    # What creeps is slow: in sliding its bristle sees a little less than the velocity, and carries the same.
    "Creep": ({"compliance": 0.1}, lambda x, v: np.sign(v) * _level(v) + S2 * v),
    "ConstantLoad": ({"load": 0.3}, lambda x, v: np.sign(v) * _level(v) + S2 * v + 0.3),
    "DirectionAsymmetry": (
        {"coulomb": 0.2},
        lambda x, v: np.sign(v) * _level(v) * (1.0 + 0.2 * np.sign(v)) + S2 * v,
    ),
    "ViscousAsymmetry": (
        {"viscous": 0.5},
        lambda x, v: np.sign(v) * _level(v) + S2 * v * (1.0 + 0.5 * np.sign(v)),
    ),
    "CoulombAndViscousAsymmetry": (
        {"coulomb": 0.2, "viscous": 0.5},
        lambda x, v: (np.sign(v) * _level(v) + S2 * v) + 0.2 * _level(v) + 0.5 * S2 * np.abs(v),
    ),
    "FewElements": ({"share": 0.6}, lambda x, v: np.sign(v) * _level(v) + S2 * v),
    "MaxwellSlip": ({"share": 0.6}, lambda x, v: np.sign(v) * _level(v) + S2 * v),
    "PositionDependence": (
        {"linear": 0.3, "quadratic": -0.2},
        lambda x, v: np.sign(v) * _level(v) * _polynomial(x, 0.3, -0.2) + S2 * v,
    ),
    "PeriodicPositionDependence": (
        {"sine": 0.1, "cosine": 0.2},
        lambda x, v: np.sign(v) * _level(v) * (1.0 + _wave(x, 0.1, 0.2)) + S2 * v,
    ),
    "ReturnSpring": ({"stiffness": 400.0}, lambda x, v: np.sign(v) * _level(v) + S2 * v + 400.0 * x),
    "Ripple": (
        {"sine": 0.1, "cosine": 0.2},
        lambda x, v: np.sign(v) * _level(v) + S2 * v + _wave(x, 0.1, 0.2),
    ),
    "RippleWithOvertones": (
        {"sine": 0.1, "cosine": 0.2, "sine2": 0.05, "cosine2": -0.03, "sine3": 0.02, "cosine4": 0.01},
        lambda x, v: (
            np.sign(v) * _level(v)
            + S2 * v
            + _wave(x, 0.1, 0.2)
            + _wave(x, 0.05, -0.03, 2e-4)
            + _wave(x, 0.02, 0.0, 4e-4 / 3)
            + _wave(x, 0.0, 0.01, 1e-4)
        ),
    ),
    "StribeckShape": (
        {"exponent_change": -1.0},
        lambda x, v: np.sign(v) * (FC + (FS - FC) * np.exp(-abs(v) / VS)) + S2 * v,
    ),
    "LorentzianStribeck": (
        {"blend": 1.0},
        lambda x, v: np.sign(v) * (FC + (FS - FC) / (1.0 + (v / VS) ** 2)) + S2 * v,
    ),
    "CreepingSlip": ({"compliance": 0.1}, _steady()),
    "LogarithmicCreep": ({"compliance": 0.1}, _steady()),
    "TwoStageCreep": ({"compliance": 0.1}, _steady()),
    "ElastoPlastic": ({"plasticity": 0.7}, _steady()),
    "SharpYield": ({"exponent_change": 2.0}, _steady()),
    "MicroDamping": ({"fall": 0.8}, _steady()),
    "ViscoelasticDamping": ({"stiffness": 0.1}, _steady()),
    "FrictionLag": ({"lag": 0.01}, _steady()),
    "GravityPendulum": (
        {"sine": 0.3, "cosine": 0.2},
        _steady(more=lambda x, v: 0.3 * np.sin(x) + 0.2 * np.cos(x)),
    ),
    "QuadraticDrag": ({"drag": 7.0}, _steady(more=lambda x, v: 7.0 * np.sign(v) * v**2)),
    "CubicDrag": ({"drag": 70.0}, _steady(more=lambda x, v: 70.0 * v**3)),
    "LoadDependence": ({"growth": 0.2}, _steady(more=lambda x, v: 0.2 * PUSH * np.sign(v))),
    "TorqueRipple": ({"sine": 0.1, "cosine": 0.2}, _steady(more=lambda x, v: -PUSH * _wave(x, 0.1, 0.2))),
    "TorqueRippleWithOvertone": (
        {"sine": 0.1, "cosine": 0.2, "sine2": 0.05, "cosine2": -0.03},
        _steady(more=lambda x, v: -PUSH * (_wave(x, 0.1, 0.2) + _wave(x, 0.05, -0.03, 2e-4))),
    ),
    "DwellStrengthening": (
        {"growth": 0.05, "onset": 0.01},
        _steady(more=_aged(0.05, lambda age: np.log(1.0 + age / 0.01))),
    ),
    "SaturatingStrengthening": (
        {"growth": 0.2, "time": 0.01},
        _steady(more=_aged(0.2, lambda age: 1.0 - np.exp(-age / 0.01))),
    ),
    "WarmupByTime": (
        {"fall": 0.2, "viscous_fall": 0.3},
        _steady(0.8, lambda x, v: -0.3 * S2 * v),
    ),
    "WarmupByHeat": (
        {"fall": 0.2, "viscous_fall": 0.3, "time_constant": 2.0, "distance": 0.1},
        _steady(
            lambda x, v: 1.0 - 0.2 * 20.0 * abs(v),
            lambda x, v: S2 * v * np.expm1(-0.3 * 20.0 * abs(v)),
        ),
    ),
    # Where no temperature was measured nothing is said of it.
    "WarmupByTemperature": ({"fall": 0.2}, _steady()),
}
"""Strengths of each form, and the force that opposes steady sliding at x and v under the motor force PUSH."""


def test_the_table_of_closed_forms_is_complete():
    elsewhere = AbstractInputEffect | AbstractSensorEffect | AbstractLoadEffect | AbstractSpringEffect
    others = {name for name, form in FORMS.items() if issubclass(form, elsewhere)}
    assert set(SLIDING) == set(FORMS) - others


X, V = (grid.ravel() for grid in np.meshgrid([-6e-4, 0.0, 2.3e-4, 9e-4], [-0.05, -1e-3, 4e-4, 1e-3, 0.2]))


def _sliding(drive, x, v):
    """Opposing force of `drive` in steady sliding, and the rate of its bristles."""
    hidden, level = jnp.zeros(drive.hidden_count), jnp.zeros(())
    for _ in range(3):  # the level may rest on the states, and they on the level
        now = drive.instant(x, v, PUSH, jnp.sign(v) * level, hidden)
        source, rate = drive.relaxation(now)
        hidden = jnp.where(rate > 0.0, source / rate, 0.0)  # a state that nothing moves stays
        level = drive.level_at(drive.instant(x, v, PUSH, now.spring, hidden))
    z = jnp.sign(v) * level * drive.bristles().slack / S0
    return drive.friction_force(drive.bristles(), x, v, z, H, hidden, PUSH)


@pytest.fixture(scope="module")
def sliding():
    """Force and rate of every form at X and V, form -> (force, rate): all in one program."""
    drives = {form: TABLE_I.with_effects(effect(form, **own)) for form, (own, _) in SLIDING.items()}

    @eqx.filter_jit
    def every(drives, x, v):
        return {form: jax.vmap(_sliding, (None, 0, 0))(drive, x, v) for form, drive in drives.items()}

    return every(drives, X, V)


@pytest.mark.parametrize("form", SLIDING)
def test_force_of_steady_sliding_is_the_closed_form(sliding, form):
    force, rate = sliding[form]
    np.testing.assert_allclose(force, SLIDING[form][1](X, V), rtol=1e-12)
    assert float(jnp.max(jnp.abs(rate))) < 1e-13  # sliding is steady: no bristle bends further


@pytest.mark.parametrize("hardening", [-0.39, -0.12, 0.0, 0.8])
def test_a_nonlinear_bristle_slides_at_the_same_level_bent_less_or_more(hardening):
    """Closed form: sigma0 z (1 + hardening (sigma0 z/Fs)^2) = G, a cubic in z; over a root where softer."""
    drive = TABLE_I.with_effects(effect("NonlinearBristle", hardening=hardening))
    for v in (-0.05, 4e-4, 0.2):
        if hardening > 0.0:
            roots = np.roots([hardening * (S0 / FS) ** 2, 0.0, 1.0, -_level(v) / S0])
            z = min(float(np.real(r)) for r in roots if abs(np.imag(r)) < 1e-9 and np.real(r) > 0.0)
        else:
            z = _level(v) / S0 / np.sqrt(1.0 + 2.0 * hardening * (_level(v) / FS) ** 2)
        bent = jnp.asarray([np.sign(v) * z])
        force, rate = drive.friction_force(drive.bristles(), jnp.zeros(()), jnp.asarray(v), bent, H)
        assert float(force) == pytest.approx(np.sign(v) * _level(v) + S2 * v, rel=1e-9)
        assert abs(float(rate[0])) < 1e-9 * abs(v)


def test_creep_goes_on_under_a_constant_force_and_ends():
    """Half of break-away held for ten time constants: the elastic deflection, then compliance times as much again."""
    drive = TABLE_I.with_effects(effect("Creep", compliance=0.3, time_constant=0.02))
    x = np.asarray(
        simulate(drive, np.full(800, 0.075), 2000.0).x
    )  # a twentieth of Fs: the bristle stays straight
    elastic = float(simulate(TABLE_I, np.full(800, 0.075), 2000.0).x[-1])
    assert x[-1] / elastic == pytest.approx(1.3, rel=0.02)
    at_one = (
        x[40 + 20] / elastic - 1.0
    )  # one time constant after the elastic response, which takes some 10 ms
    assert at_one == pytest.approx(0.3 * (1.0 - np.exp(-(60 - 10) / 40)), rel=0.1)


def test_near_break_away_a_creeping_slip_goes_further():
    """Slow ramps to 90 % of break-away, long against the time constant, where x_c = compliance F_z/sigma0. With
    b = F_z/Fs, dx/dF_z = (1/(1 - b) + compliance)/sigma0 where creep is beside the contact, and
    (1 + compliance)/(sigma0 (1 - b)) where the bristle slips with it."""
    force = np.linspace(0.0, 1.35, 8000)
    elastic, plastic = 1.35 / 1e5, -1.5 * np.log(1.0 - 0.9) / 1e5
    ends = {
        form: float(
            simulate(
                TABLE_I.with_effects(effect(form, compliance=0.4, time_constant=0.02)),
                force,
                2000.0,
                substeps=4,
            ).x[-1]
        )
        for form in ("Creep", "CreepingSlip")
    }
    assert ends["Creep"] == pytest.approx(plastic + 0.4 * elastic, rel=0.01)
    assert ends["CreepingSlip"] == pytest.approx(1.4 * plastic, rel=0.01)


def test_two_stages_of_creep_are_two_creeps():
    """A fast and a slow element, against two creeps of one element each in series."""
    stages = effect("TwoStageCreep", compliance=0.3, time_constant=0.01, ratio=8.0, slow_part=0.4)
    fast = effect("Creep", compliance=0.18, time_constant=0.01)
    slow = effect("Creep", compliance=0.12, time_constant=0.08)
    force = np.where(np.arange(800) < 500, 0.4, -0.1)
    together, apart = (
        np.asarray(simulate(TABLE_I.with_effects(*some), force, 2000.0).x)
        for some in ((stages,), (fast, slow))
    )
    np.testing.assert_allclose(together, apart, rtol=1e-9, atol=1e-12 * np.abs(apart).max())


def test_outside_the_stroke_the_polynomial_stays_where_it_was():
    drive = TABLE_I.with_effects(effect("PositionDependence", linear=0.5))
    v = jnp.asarray(0.1)
    near, far = (float(drive.level(jnp.asarray(1e-4 + p * 1e-3), v)) for p in (1.2, 5.0))
    assert near == far == pytest.approx(1.6, rel=1e-9)


def test_direction_asymmetry_makes_two_levels_and_no_force_at_rest():
    drive = TABLE_I.with_effects(
        effect("DirectionAsymmetry", coulomb=0.2), effect("ViscousAsymmetry", viscous=0.3)
    )
    zero = jnp.zeros(())
    left, right = (float(drive.level(zero, jnp.asarray(v))) for v in (-0.1, 0.1))
    assert (left, right) == (pytest.approx(0.8, rel=1e-9), pytest.approx(1.2, rel=1e-9))
    force, rate = drive.friction_force(drive.bristles(), zero, zero, jnp.zeros(1), H)
    assert float(force) == 0.0 and float(rate[0]) == 0.0


def test_effects_of_one_slot_act_one_after_the_other():
    tilted, wavy = effect("PositionDependence", linear=0.3), effect("PeriodicPositionDependence", sine=0.2)
    x, v = jnp.asarray(1.3e-4), jnp.asarray(0.01)
    alone = [float(TABLE_I.with_effects(one).level(x, v)) for one in (tilted, wavy)]
    both = float(TABLE_I.with_effects(tilted).with_effects(wavy).level(x, v))
    assert both == pytest.approx(alone[0] * alone[1] / float(TABLE_I.level(x, v)), rel=1e-13)
    loads = TABLE_I.with_effects(effect("ConstantLoad", load=0.2), effect("ReturnSpring", stiffness=50.0))
    expected = 0.4 * 0.01 + 0.2 + 50.0 * 1.3e-4
    assert float(loads.parallel_force(loads.instant(x, v))) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(
    ("form", "time"), [("DwellStrengthening", "onset"), ("SaturatingStrengthening", "time")]
)
def test_contacts_age_slowly_enough_to_differ_between_the_shortest_rests_of_a_log(form, time):
    """Faster ones are as old after rests of 50 ms as after any other; they make a Stribeck curve, another effect."""
    (shortest,) = (one.lower for one in type(effect(form)).nuisances if one.name == time)
    assert 0.002 < np.exp(-0.05 / shortest) < 0.02
