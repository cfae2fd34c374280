"""Derivatives of a run: of the base model against 80-bit numbers, of every effect in force, and none that is NaN."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_lugre_numpy import numbers, ros2_longdouble, slopes_longdouble
from helpers_plants import FORMS, LARGE, LOADS, PLANTS, TABLE_I, effect
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate

RATE, N = 2000.0, 240
T = np.arange(N) / RATE
NOISE = np.random.default_rng(3).normal(size=N)
SHAPES = {
    "presliding, then both ways": 1.5
    * np.where(T < 0.06, 0.53 * np.sin(2 * np.pi * 50.0 * T), 1.7 * np.sin(2 * np.pi * 25.0 * T)),
    "rest, then break-away": np.maximum(0.0, 3.0 * (T - 0.04) / T[-1]),
    "noise": 0.7 * NOISE,
    "loud noise": 5.0 * NOISE,
}
"""Motor force over break-away force."""

BASES = {name: np.array(numbers(drive)) for name, drive in PLANTS.items()}
BASES["fast bristle"] = np.array([0.0121, 6581.0, 8.9, 0.13, 0.074, 0.185, 0.43])
"""One whose deflections are cut on loud noise: rates of the bristle up to 200 times those of the steps."""

needs_80_bits = pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no long double here")


@functools.partial(jax.jit, static_argnums=3)
def _base(logs, base, force, substeps):
    J, *friction = jnp.exp(logs) * base
    return simulate(Drive(J, LuGre(*friction)), force, RATE, substeps=substeps).x


_base_slopes = jax.jit(jax.jacfwd(_base), static_argnums=3)


def _gap(derivative, exact):
    """Largest difference over the largest value, of the worst column."""
    return float(np.max(np.max(np.abs(derivative - exact), axis=0) / np.max(np.abs(exact), axis=0)))


@needs_80_bits
@pytest.mark.parametrize("plant", BASES)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("substeps", [1, 2])
def test_the_base_model_and_its_derivatives_agree_with_80_bits(plant, shape, substeps):
    """The scheme written again in numpy: the run to the last bits; its derivatives by each of the seven parameters."""
    base = BASES[plant]
    force = SHAPES[shape] * base[5] * (10.0 if plant == "fast bristle" else 1.0)
    exact, turned, cuts = ros2_longdouble(base[:, None], force, RATE, substeps)
    x = np.asarray(_base(jnp.zeros(7), jnp.asarray(base), jnp.asarray(force), substeps))
    assert np.max(np.abs(x - exact[:, 0])) < 1e-13 * np.ptp(exact)  # measured: 1e-16 to 3e-14
    slopes = np.asarray(_base_slopes(jnp.zeros(7), jnp.asarray(base), jnp.asarray(force), substeps))
    assert _gap(slopes, slopes_longdouble(base, force, RATE, substeps)) < 1e-8  # 1e-12 to 9e-10
    # The cases are what they claim to be.
    assert (turned > 0) == (shape != "rest, then break-away") or shape.startswith("presliding")
    assert (cuts > 0) == (plant == "fast bristle" and shape == "loud noise")


@needs_80_bits
def test_at_rest_the_80_bit_derivatives_are_zero_and_so_are_ours():
    base = BASES["stage"]
    assert not np.any(slopes_longdouble(base, np.zeros(20), RATE))
    assert not np.any(_base_slopes(jnp.zeros(7), jnp.asarray(base), jnp.zeros(20), 2))


PARAMETERS = [(name, p) for name, form in FORMS.items() for p in form.strengths + form.nuisances]
"""Every strength and every nuisance of every form."""


def _in_force(form):
    """Strengths of LARGE and the nuisances that go with them."""
    names = [parameter.name for parameter in FORMS[form].strengths]
    made = effect(form, **dict(zip(names, LARGE[form], strict=True)))
    return tuple(float(getattr(made, p.name)) for name, p in PARAMETERS if name == form)


IN_FORCE = {form: _in_force(form) for form in FORMS} | {
    "Creep": (0.5, 0.02),
    "Delay": (1.3 / RATE,),
    "DriveLag": (2.0 / RATE,),
    "FewElements": (0.5, 0.6, 1.4, 0.9, 2.0, 0.7, 0.4),
    "MaxwellSlip": (0.5, 1.5, -0.3),
}
"""Strengths and nuisances of each form, in the order of PARAMETERS, on the plant of Table I; none is zero."""

U = (
    1.5
    * np.where(T < 0.03, 0.53 * np.sin(2 * np.pi * 50.0 * T), 2.2 * np.sin(2 * np.pi * 25.0 * T + 0.3))[:160]
)


def _with(drive, values):
    """`drive` with every form that `values` has, name -> values in the order of PARAMETERS."""
    effects = []
    for name, own in values.items():
        fields = [p.name for form, p in PARAMETERS if form == name]
        effects.append(FORMS[name](**dict(zip(fields, own, strict=True))))
    return drive.with_effects(*effects)


@eqx.filter_jit
def _relative(factors, values, u):
    """Measured position when each value is multiplied by its factor; `factors` and `values` name -> array."""
    drive = _with(TABLE_I, {name: factors[name] * values[name] for name in values})
    return simulate(drive, u, RATE).measured


QUICK = ("ConstantLoad", "Creep", "MaxwellSlip", "StribeckShape", "FlexibleTransmission")
ALONE_AND_ALL = {name: (name,) for name in FORMS} | {
    # A drive takes one inertia of its own; behind a gap it would not be touched. What clips has corners.
    "all": tuple(name for name in FORMS if name not in ("Backlash", "HardSaturation", "DriveDeadzone"))
}


@pytest.mark.parametrize(
    "forms",
    [
        pytest.param(forms, id=name, marks=() if name in QUICK else pytest.mark.slow)
        for name, forms in ALONE_AND_ALL.items()
    ],
)
def test_every_parameter_of_an_effect_in_force_has_its_derivative(forms):
    """By fourth-order differences of one part in ten thousand: small enough that no elasto-slip element yields a step
    earlier or later (at 3e-4 one does, which moves that difference, not the derivative, by 0.3 %); all at once, of one
    part in a hundred thousand."""
    values = {name: jnp.asarray(IN_FORCE[name]) for name in forms}
    assert all(bool(jnp.all(own != 0.0)) for own in values.values())
    sizes = [own.size for own in values.values()]
    n, ends = sum(sizes), np.cumsum(sizes)[:-1]

    @jax.jit
    def position(factors):
        return _relative(dict(zip(values, jnp.split(factors, ends), strict=True)), values, jnp.asarray(U))

    slopes = np.asarray(jax.jacfwd(position)(jnp.ones(n)))
    assert np.all(np.max(np.abs(slopes), axis=0) > 0.0)
    step = 1e-5 if len(forms) > 1 else 1e-4
    around = 1.0 + step * np.concatenate([k * np.eye(n) for k in (-2, -1, 1, 2)])
    low2, low, high, high2 = np.asarray(jax.vmap(position)(around)).reshape(4, n, -1)
    exact = (8.0 * (high - low) - (high2 - low2)).T / (12.0 * step)
    assert _gap(slopes, exact) < 1e-6  # measured: 4e-12 to 1e-8


@jax.jit
def _late(samples):
    return simulate(_with(TABLE_I, {"Delay": (samples / RATE,)}), jnp.asarray(1.5 * NOISE), RATE).x


def test_a_delay_is_found_from_the_far_side_of_a_whole_sample():
    """Gauss-Newton from 0.4 to 1.7 samples. The index of a sample would have no derivative to go by."""
    exact, samples = _late(1.7), jnp.asarray(0.4)
    slope = jax.jit(jax.jacfwd(_late))
    way = [float(samples)]
    for _ in range(8):
        direction = slope(samples)
        samples = samples + direction @ (exact - _late(samples)) / (direction @ direction)
        way.append(float(samples))
    assert abs(way[-1] - 1.7) < 1e-6, way


@functools.partial(jax.jit, static_argnums=2)
def _one_sided(numbers, u, substeps):
    law = LuGre(1e5, 316.0, numbers[0], 1.0, 1.5, 1e-3)
    return simulate(_with(Drive(1.0, law), {"ViscousAsymmetry": (numbers[1],)}), u, RATE, substeps=substeps).x


_one_sided_slopes = jax.jit(jax.jacfwd(_one_sided), static_argnums=2)


@pytest.mark.parametrize("viscous", [0.3, 0.6, 0.9, -0.9])
@pytest.mark.parametrize("ratio", [3.0, 10.0, 30.0])
def test_a_fast_viscous_force_that_differs_with_the_direction_does_not_run_away(ratio, viscous):
    """With sigma2 `ratio` times J over the step: an A that knows one side of |v| only is too soft for the other."""
    numbers, u = jnp.asarray([2000.0 * ratio, viscous]), jnp.asarray(20.0 * NOISE)
    coarse, fine = (_one_sided(numbers, u, substeps) for substeps in (1, 64))
    # Measured: up to 2.4 with an A that takes the larger of both sides, 4e6 to 1e220 with the side of the start.
    assert float(jnp.max(jnp.abs(coarse - fine))) < 5.0 * float(jnp.ptp(fine))
    assert bool(jnp.all(jnp.isfinite(_one_sided_slopes(numbers, u, 1))))


SIZES = {"J": (1e-4, 1e3), "sigma0": (1e2, 1e8), "damping ratio": (1e-2, 10.0), "sigma2": (1e-4, 1e3)}
SIZES |= {"Fc": (1e-3, 1e3), "Fs/Fc": (1.0, 10.0), "vs": (1e-5, 1.0)}
"""Ranges from which the property test draws the base model, uniformly in the logarithm."""


def _between(low, high, unit, log):
    return low * (high / low) ** unit if log else low + (high - low) * unit


def _values(units, base):
    """An admissible value of each of PARAMETERS for `units` in [0, 1].

    Springs and periods are such that the sample rate resolves them: what depends on the position is outside A.
    """
    J, sigma0, _, _, fc, fs, vs = base
    bend, resolved = fs / sigma0, J * RATE**2
    fast = 100.0 * fs / np.sqrt(sigma0 * J)
    ranges = {
        "{position}": (low := max(3.0 * bend, 6.0 * fs / resolved), 1e4 * low),
        "{force}": (-fc, fc),
        "{force}/{position}": (0.0, min(0.1 * sigma0, resolved)),
        "{force}*s^2/{position}^2": (0.0, fc / fast**2),
        "{force}*s^3/{position}^3": (0.0, fc / fast**3),
        "{position}/s": (0.1 * vs, 10.0 * vs),
        "{input}": (0.01 * fs, 10.0 * fs),
        "1/{input}^2": (0.0, 1.0 / fs**2),
        "s": (0.0, 10.0 / RATE),
        "Hz": (1.0, 500.0),
    }
    found = []
    for (_, p), unit in zip(PARAMETERS, units, strict=True):
        low, high = (p.lower, p.upper) if np.isfinite(p.lower + p.upper) else ranges[p.unit]
        found.append(_between(low, high, unit, low > 0.0))
    return found


@jax.jit
def _slopes_and_run(numbers, u):
    def run(numbers):
        (J, *friction), values, (v0, z0) = jnp.split(numbers, [7, 7 + len(PARAMETERS)])
        names = [name for name, _ in PARAMETERS]
        own = {name: [v for n, v in zip(names, values, strict=True) if n == name] for name in FORMS}
        own.pop(LOADS[1])  # a drive takes one
        drive = _with(Drive(J, LuGre(*friction)), own)
        measured = simulate(drive, u, RATE, v0=v0, z0=z0, substeps=1).measured
        return measured, measured

    return jax.jacfwd(run, has_aux=True)(numbers)


UNIT = st.floats(0.0, 1.0)
SIZE = st.one_of(st.just(0.0), st.floats(-6.0, 2.0).map(lambda power: 10.0**power))
"""Nothing, or up to a hundred times break-away."""


@settings(max_examples=150, derandomize=True)
@given(
    sizes=st.tuples(*(UNIT for _ in SIZES)),
    units=st.tuples(*(UNIT for _ in PARAMETERS)),
    only=st.sampled_from([*FORMS, "none", "every"]),
    amounts=st.tuples(SIZE, SIZE, SIZE),
    seed=st.integers(0, 99),
)
def test_no_admissible_run_or_derivative_is_nan_or_infinite(sizes, units, only, amounts, seed):
    """Each effect alone, all at once, or none; started at rest or thrown; with and without a force."""
    J, sigma0, ratio, sigma2, fc, excess, vs = (
        _between(*ends, unit, True) for ends, unit in zip(SIZES.values(), sizes, strict=True)
    )
    base = [J, sigma0, 2.0 * ratio * np.sqrt(sigma0 * J), sigma2, fc, fc * excess, vs]
    values = _values(units, base)
    for index, (name, p) in enumerate(PARAMETERS):
        if only not in (name, "every") and p in FORMS[name].strengths:
            values[index] = 0.0
    fs, (push, speed, bent) = base[5], amounts
    start = [speed * fs / np.sqrt(sigma0 * J), -bent * fs / sigma0]
    noise = np.random.default_rng(seed)
    u = push * fs * (noise.normal(size=64) if seed % 2 else np.sign(noise.normal(size=8)).repeat(8))
    slopes, x = _slopes_and_run(jnp.asarray([*base, *values, *start]), jnp.asarray(u))
    assert bool(jnp.all(jnp.isfinite(x)))
    assert bool(jnp.all(jnp.isfinite(slopes)))
