"""Plants with known parameters, and every form of every effect: what the physics is tested on."""

import numpy as np
import pytest

from frictionjax.physics import Drive, LuGre, catalogue
from frictionjax.physics.effects.base import (
    AbstractBristleEffect,
    AbstractLoadEffect,
    AbstractSensorEffect,
    AbstractStateEffect,
)

TABLE_I = Drive(J=1.0, friction=LuGre(sigma0=1e5, sigma1=1e5**0.5, sigma2=0.4, Fc=1.0, Fs=1.5, vs=1e-3))
"""A unit mass with the parameters of Table I, as in Canudas de Wit et al. (1995): N, m, s."""

ROTARY = Drive(
    J=0.03,
    friction=LuGre(sigma0=2000.0, sigma1=6.0, sigma2=0.06, Fc=0.5, Fs=0.62, vs=0.06),
    motor_constant=16.0,
)
"""A servo arm: N m, rad, s, V. Numbers of this project."""

STAGE = Drive(
    J=13.7,
    friction=LuGre(sigma0=3.5e5, sigma1=840.0, sigma2=41.0, Fc=25.6, Fs=29.2, vs=7.7e-3),
    motor_constant=28.0,
)
"""A linear stage: N, m, s, V. Numbers of this project."""

PLANTS = {"table_i": TABLE_I, "rotary": ROTARY, "stage": STAGE}

NUISANCES = {
    "PeriodicPositionDependence": {"period": 4e-4},
    "PositionDependence": {"center": 1e-4, "half_stroke": 1e-3},
    "Ripple": {"period": 4e-4},
    "RippleWithOvertones": {"period": 4e-4},
    "MaxwellSlip": {"spread": 1.5},
    "TorqueRipple": {"period": 4e-4},
    "TorqueRippleWithOvertone": {"period": 4e-4},
    "EncoderError": {"period": 4e-4},
    "EncoderErrorWithOvertone": {"period": 4e-4},
    "DwellStrengthening": {"length": 1.5e-5},
    "WarmupByHeat": {"distance": 0.02, "time_constant": 1.5},
    "WarmupByTime": {"time_constant": 1.5},
    "HardSaturation": {"largest": 3.75},
    "Backlash": {"gap": 1e-4},
}
"""Values for a plant of the size of Table I."""

FORMS = {form.__name__: form for forms in catalogue().values() for form in forms}
"""Every form of every effect, by the name of its class."""

SMALL = {
    "Delay": 1e-5,
    "DriveLag": 1e-5,
    "FrictionLag": 1e-3,
    "SensorLag": 1e-4,
    "EncoderError": 1e-7,
    "EncoderErrorWithOvertone": 1e-7,
    "MainsPickup": 1e-7,
    "ReturnSpring": 30.0,
    "QuadraticDrag": 1e3,
    "CubicDrag": 1e5,
}
"""A small value of the strengths of a form, for scale, on a plant of the size of Table I; 0.01 for those left out."""

SENSORS = tuple(name for name, form in FORMS.items() if issubclass(form, AbstractSensorEffect))
"""Forms that change what is measured, not how the machine moves."""

LOADS = tuple(name for name, form in FORMS.items() if issubclass(form, AbstractLoadEffect))
"""Forms with an inertia of their own, of which a drive takes one."""

BRISTLES = tuple(name for name, form in FORMS.items() if issubclass(form, AbstractBristleEffect))
"""Forms with elements parallel to the bristle."""

STATES = tuple(name for name, form in FORMS.items() if issubclass(form, AbstractStateEffect))
"""Forms with states of their own."""

STRENGTHS = [(name, parameter.name) for name, form in FORMS.items() for parameter in form.strengths]
"""Every strength of every form."""


LARGE = {
    "Backlash": (0.3,),
    "ConstantLoad": (0.2,),
    "Creep": (2.5,),
    "CreepingSlip": (2.0,),
    "LogarithmicCreep": (0.5,),
    "TwoStageCreep": (1.0,),
    "Delay": (0.7e-3,),
    "DirectionAsymmetry": (0.1,),
    "ViscousAsymmetry": (0.5,),
    "CoulombAndViscousAsymmetry": (0.1, 0.5),
    "DriveDeadzone": (0.3,),
    "DriveLag": (1e-3,),
    "SoftSaturation": (0.3,),
    "HardSaturation": (0.5,),
    "DwellStrengthening": (0.3,),
    "SaturatingStrengthening": (2.0,),
    "ElastoPlastic": (0.8,),
    "EncoderError": (3e-7, -2e-7),
    "EncoderErrorWithOvertone": (3e-7, -2e-7, 1e-7, 2e-7),
    "FlexibleTransmission": (0.3,),
    "FrictionLag": (2e-3,),
    "GravityPendulum": (50.0, 0.2),
    "LoadDependence": (0.15,),
    "MainsPickup": (3e-7, -2e-7, 0.0, 1e-7, -2e-7, 1e-7),
    "FewElements": (0.0,),
    "MaxwellSlip": (0.0,),
    "SharpYield": (1.5,),
    "MicroDamping": (0.8,),
    "NonlinearBristle": (0.6,),
    "NonlinearBristleByDeflection": (0.4,),
    "PositionDependence": (0.3, -0.2),
    "PeriodicPositionDependence": (0.2, 0.2),
    "QuadraticDrag": (1e3,),
    "CubicDrag": (3e4,),
    "ReturnSpring": (3e3,),
    "Ripple": (0.1, 0.1),
    "RippleWithOvertones": (0.1, 0.1, 0.05, -0.05, 0.03, 0.02, -0.02, 0.01),
    "SensorLag": (1e-3,),
    "LorentzianStribeck": (0.8,),
    "StribeckShape": (-0.8,),
    "TorqueRipple": (0.2, -0.1),
    "TorqueRippleWithOvertone": (0.2, -0.1, 0.05, 0.1),
    "ViscoelasticDamping": (0.3,),
    "WarmupByTime": (0.9, 0.9),
    "WarmupByHeat": (3.0, 3.0),
    "WarmupByTemperature": (0.5,),
}
"""Strengths of each form that tell on a plant of the size of Table I; elasto-slip elements have tests of their own."""


def some_slow(forms, quick):
    """`forms` for a parametrized test, all but the `quick` ones marked slow: each compiles code of its own."""
    return [form if form in quick else pytest.param(form, marks=pytest.mark.slow) for form in forms]


def effect(name, **strengths):
    """The form `name`, with zero strengths but those given."""
    return FORMS[name](**(NUISANCES.get(name, {}) | strengths))


def with_every_effect(drive, strengths, *, but=()):
    """`drive` with every form of every effect, `but` some; `strengths` is one number for each of STRENGTHS."""
    values = dict(zip(STRENGTHS, strengths, strict=True))
    return drive.with_effects(
        *(
            effect(form, **{p: v for (f, p), v in values.items() if f == form})
            for form in FORMS
            if form not in but
        )
    )


_APART = (*STATES, *LOADS, *SENSORS, *BRISTLES)

_ONE_A_SLOT = (
    *(
        "ConstantLoad",
        "Creep",
        "Delay",
        "DirectionAsymmetry",
        "ViscousAsymmetry",
        "DriveLag",
        "ElastoPlastic",
    ),
    *("LoadDependence", "MicroDamping", "NonlinearBristle", "PositionDependence", "Ripple", "StribeckShape"),
)

MOVING = [form for form in FORMS if form not in (*SENSORS, *BRISTLES)]
"""Every form that changes how a machine moves, but elasto-slip elements."""

MOVERS = some_slow(MOVING, _ONE_A_SLOT)
"""Every form that changes how a machine moves, but elasto-slip elements; one or two of each slot are not slow."""


def in_large(form):
    """TABLE_I with the strengths LARGE of `form`: one structure, and one compilation, for all forms but a few."""
    own = dict(zip([parameter.name for parameter in FORMS[form].strengths], LARGE[form], strict=True))
    if form in _APART:
        return TABLE_I.with_effects(effect(form, **own))
    strengths = [own[strength] if name == form else 0.0 for name, strength in STRENGTHS]
    return with_every_effect(TABLE_I, strengths, but=_APART)


def every_size(value):
    """A plant all of whose sizes, by the names that parameters of effects use, have this `value`; positions in rad."""
    parameters = [one for form in FORMS.values() for one in (*form.strengths, *form.nuisances)]
    return {one.scale: value for one in parameters if isinstance(one.scale, str)} | {"turn": 2.0 * np.pi}
