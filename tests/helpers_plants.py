"""Plants with known parameters, and every form of every effect: what the physics is tested on."""

from frictionjax.physics import Drive, LuGre, catalogue

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
    "MaxwellSlip": {"spread": 1.5},
    "TorqueRipple": {"period": 4e-4},
    "EncoderError": {"period": 4e-4},
    "DwellStrengthening": {"length": 1.5e-5},
    "WarmupByHeat": {"distance": 0.1},
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
    "MainsPickup": 1e-7,
    "ReturnSpring": 30.0,
    "QuadraticDrag": 1e3,
    "CubicDrag": 1e5,
}
"""A small value of the strengths of a form, for scale, on a plant of the size of Table I; 0.01 for those left out."""

STRENGTHS = [(name, parameter.name) for name, form in FORMS.items() for parameter in form.strengths]
"""Every strength of every form."""


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
