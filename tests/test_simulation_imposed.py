"""`simulate_imposed`: friction under an imposed motion, against scipy, closed forms and `simulate`."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_lugre_numpy import numbers
from helpers_plants import FORMS, PLANTS, ROTARY, STAGE, STRENGTHS, TABLE_I, effect, with_every_effect
from helpers_traces import programs
from scipy.integrate import solve_ivp

from frictionjax.core import InputError, PrecisionError
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate, simulate_imposed
from frictionjax.simulation.imposed import imposed_friction

BEND = {name: float(plant.friction.Fs / plant.friction.sigma0) for name, plant in PLANTS.items()}
"""Deflection at break-away."""


def sine(amplitude, frequency, phase=0.3):
    """Position and velocity as functions of time, and no corners."""
    w = 2 * np.pi * frequency
    return lambda t: (amplitude * np.sin(w * t + phase), amplitude * w * np.cos(w * t + phase)), []


def zigzag(turns, speed):
    """From turn to turn at constant `speed`: the motion, which takes the later side of a corner, and the corners."""
    turns = np.asarray(turns, float)
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)) / speed)])

    def motion(t):
        leg = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        return np.interp(t, times, turns), speed * np.sign(np.diff(turns))[leg]

    return motion, list(times)


def reference(drive, motion, t, *, corners=(), shape=lambda x, v: 1.0, hardening=0.0, creep=(0.0, 1.0)):
    """Friction force and deflection at the instants `t`, the equations written out again; both sides of a corner."""
    _, s0, s1, s2, fc, fs, vs = numbers(drive)
    compliance, lag = creep
    unit = fs / s0

    def parts(x, v, y):
        level = (fc + (fs - fc) * np.exp(-((v / vs) ** 2))) * shape(x, v)
        z, crept = y * unit
        spring = s0 * z * (1.0 + hardening * (s0 * z / fs) ** 2)
        crept_rate = (compliance * spring / s0 - crept) / lag
        seen = v - crept_rate
        rate = seen - abs(seen) * spring / level
        return spring + s1 * rate + s2 * v, np.array([rate, crept_rate]) / unit

    cuts = np.unique(np.concatenate([[t[0], t[-1]], [c for c in corners if t[0] + 1e-9 < c < t[-1] - 1e-9]]))
    force, deflection, sides, y = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size), np.zeros(2)
    for first, last in itertools.pairwise(cuts):
        inside = lambda time, a=first, b=last: np.clip(time, a + 1e-9 * (b - a), b - 1e-9 * (b - a))  # noqa: E731
        at = np.flatnonzero((t > first - 1e-9) & (t < last + 1e-9))
        solution = solve_ivp(
            lambda time, y, side=inside: parts(motion(time)[0], motion(side(time))[1], y)[1],
            (first, last),
            y,
            "LSODA",
            t_eval=np.clip(t[at], first, last),
            rtol=1e-10,
            atol=1e-12,
            max_step=(last - first) / 50,
        )
        assert solution.success
        for k, state in zip(at, solution.y.T, strict=True):
            force[k] += parts(motion(t[k])[0], motion(inside(t[k]))[1], state)[0]
            deflection[k], sides[k] = state[0] * unit, sides[k] + 1
        y = solution.y[:, -1]
    return force / sides, deflection


def worst(found, exact, scale, trim=2):
    """Largest error over `scale`, but for the samples at both ends, where the velocity is of first order only."""
    return np.max(np.abs(np.asarray(found) - exact)[trim:-trim]) / scale


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize(
    ("strokes", "frequency", "tolerance"), [(0.3, 5.0, 2e-5), (3.0, 5.0, 1e-4), (50.0, 1.0, 2e-3)]
)
def test_a_sine_is_that_of_scipy(plant, strokes, frequency, tolerance):
    """Amplitudes from presliding to sliding, over the break-away deflection; 1000 samples per second."""
    drive, t = PLANTS[plant], np.arange(1001) / 1000.0
    motion, _ = sine(strokes * BEND[plant], frequency)
    exact, deflection = reference(drive, motion, t)
    run = simulate_imposed(drive, motion(t)[0], 1000.0)
    fs = float(drive.friction.Fs)
    assert worst(run.friction, exact, fs) < tolerance
    assert worst(run.z[:, 0], deflection, BEND[plant]) < tolerance
    assert worst(run.v, motion(t)[1], np.max(np.abs(motion(t)[1]))) < 1e-3
    measured = simulate_imposed(drive, motion(t)[0], 1000.0, v=motion(t)[1])
    assert worst(measured.friction, exact, fs) < 2.0 * tolerance + 2e-5


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("turns", [(0, 8, -8, 8), (0, 1, -1, 0.5, -0.25, 0.5, -1, 1)], ids=["wide", "nested"])
def test_constant_velocity_is_exact_whatever_the_step(plant, turns):
    """Ten samples to a break-away deflection; the corners lie on samples, the one with z in presliding or sliding."""
    drive, bend = PLANTS[plant], BEND[plant]
    speed = 0.3 * float(drive.friction.vs)
    motion, corners = zigzag(bend * np.array(turns), speed)
    rate = 20.0 * speed / bend
    t = np.arange(round(corners[-1] * rate) + 1) / rate
    run = simulate_imposed(drive, motion(t)[0], rate)
    exact, _ = reference(drive, motion, t, corners=corners)
    assert worst(run.friction, exact, float(drive.friction.Fs), trim=1) < 1e-7


def test_the_error_falls_with_the_square_of_the_step():
    motion, _ = sine(1e-4, 5.0)
    errors = []
    for rate in (500, 2000):
        t = np.arange(rate + 1) / rate
        exact, _ = reference(TABLE_I, motion, t)
        run = simulate_imposed(TABLE_I, motion(t)[0], rate)
        finer = simulate_imposed(TABLE_I, motion(t)[0], rate, v=motion(t)[1], substeps=2)
        errors.append([worst(run.friction, exact, 1.5), worst(finer.friction, exact, 1.5)])
    orders = np.log2(np.divide(*errors)) / 2.0
    np.testing.assert_allclose(orders, 2.0, atol=0.25)


def test_steady_sliding_is_the_level_and_the_viscous_force():
    for v in (2e-4, -1e-3, 0.05):
        x = v * np.arange(3000) / 1000.0
        friction = simulate_imposed(TABLE_I, x, 1000.0).friction
        level = 1.0 + 0.5 * np.exp(-((v / 1e-3) ** 2))
        np.testing.assert_allclose(friction[-1], level * np.sign(v) + 0.4 * v, rtol=1e-9)


def test_slow_presliding_is_the_exponential_of_the_distance():
    """F = Fs (1 - exp(-s0 x/Fs)), and after a turn at (a, F) the branch towards -Fs: at 1 nm/s, G is Fs."""
    up, down = np.linspace(0.0, 44.936e-6, 200), np.linspace(44.936e-6, -3e-5, 300)[1:]
    friction = np.asarray(simulate_imposed(TABLE_I, np.concatenate([up, down]), 1e-2).friction)
    virgin = 1.5 * (1.0 - np.exp(-1e5 * up / 1.5))
    assert virgin[-1] == pytest.approx(0.95 * 1.5, rel=1e-4)
    branch = -1.5 + (virgin[-1] + 1.5) * np.exp(1e5 * (down - up[-1]) / 1.5)
    np.testing.assert_allclose(friction, np.concatenate([virgin, branch]), atol=3e-3)  # sigma1 at 2e-9 m/s
    still = eqx.tree_at(lambda drive: drive.friction.sigma1, TABLE_I, jnp.zeros(()))
    slow = np.asarray(simulate_imposed(still, np.concatenate([up, down]), 1e-2).friction)
    np.testing.assert_allclose(slow, np.concatenate([virgin, branch]), atol=1e-8)


EFFECTS = {
    "DirectionAsymmetry": ({"coulomb": 0.15}, {"shape": lambda x, v: 1.0 + 0.15 * np.sign(v)}),
    "PositionDependence": (
        {"linear": 0.3, "quadratic": -0.2},
        {"shape": lambda x, v: 1.0 + 0.3 * (x / 1e-3 - 0.1) - 0.2 * (1.5 * (x / 1e-3 - 0.1) ** 2 - 0.5)},
    ),
    "NonlinearBristle": ({"hardening": 0.8}, {"hardening": 0.8}),
    "Creep": ({"compliance": 0.4, "time_constant": 0.05}, {"creep": (0.4, 0.05)}),
    "StribeckShape": (
        {"exponent_change": -1.0},
        {
            "shape": lambda x, v: (
                (1.0 + 0.5 * np.exp(-abs(v / 1e-3))) / (1.0 + 0.5 * np.exp(-(abs(v / 1e-3) ** 2)))
            )
        },
    ),
}


@pytest.mark.parametrize("form", EFFECTS)
@pytest.mark.parametrize("stroke", [1.5e-5, 2e-4])
def test_an_effect_inside_the_law_is_that_of_scipy(form, stroke):
    ours, theirs = EFFECTS[form]
    motion, _ = sine(stroke, 2.0)
    t = np.arange(2001) / 2000.0
    exact, _ = reference(TABLE_I, motion, t, **theirs)
    drive = TABLE_I.with_effects(effect(form, **ours))
    assert worst(simulate_imposed(drive, motion(t)[0], 2000.0).friction, exact, 1.5) < 3e-4
    base = simulate_imposed(TABLE_I, motion(t)[0], 2000.0).friction
    assert worst(base, exact, 1.5) > 1e-2


@pytest.mark.parametrize("stroke", [1.5e-5, 2e-4])
def test_maxwell_slip_is_a_bank_of_plays(stroke):
    """The plays followed on a grid 50 times finer; without bristle damping, which is a mean over a sample."""
    drive = Drive(1.0, LuGre(1e5, 0.0, 0.4, 1.0, 1.5, 1e-3), effects=(effect("MaxwellSlip", share=0.6),))
    motion, _ = sine(stroke, 2.0)
    t, fine = np.arange(2001) / 2000.0, np.arange(100_001) / 100_000.0
    slack = np.exp(1.5 * (2.0 * (np.arange(16) + 0.5) / 16 - 1.0))
    x, v = motion(fine)
    limit = np.outer((1.0 + 0.5 * np.exp(-((v / 1e-3) ** 2))) / 1e5, slack / np.mean(slack))
    plays, played = np.zeros(16), [np.zeros(16)]
    for way, most in zip(np.diff(x), limit[1:], strict=True):
        plays = np.clip(plays + way, -most, most)
        played.append(plays)
    bristle, _ = reference(drive, motion, t)
    exact = 0.4 * bristle + 0.6 * (1e5 * np.mean(played, axis=1)[::50] + 0.4 * motion(t)[1])
    run = simulate_imposed(drive, motion(t)[0], 2000.0)
    assert run.z.shape == (2001, 17)
    assert worst(run.friction, exact, 1.5) < 5e-4


FORCES = {
    "ConstantLoad": ({"load": 0.3}, lambda x, v: 0.3),
    "ReturnSpring": ({"stiffness": 50.0}, lambda x, v: 50.0 * x),
    "ViscousAsymmetry": ({"viscous": 0.2}, lambda x, v: 0.08 * np.abs(v)),
    "Ripple": (
        {"sine": 0.1, "cosine": 0.2},
        lambda x, v: 0.1 * np.sin(x * 5e3 * np.pi) + 0.2 * np.cos(x * 5e3 * np.pi),
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_effect_runs_and_beside_the_law_adds_its_force(form):
    motion, _ = sine(2e-4, 2.0)
    t = np.arange(501) / 500.0
    base = simulate_imposed(TABLE_I, motion(t)[0], 500.0)
    none = simulate_imposed(TABLE_I.with_effects(effect(form)), motion(t)[0], 500.0)
    np.testing.assert_allclose(none.friction, base.friction, atol=2e-14)
    if form in FORCES:
        strengths, force = FORCES[form]
        run = simulate_imposed(TABLE_I.with_effects(effect(form, **strengths)), motion(t)[0], 500.0)
        np.testing.assert_allclose(run.friction - base.friction, force(run.x, run.v), atol=1e-7)


def test_effects_of_the_input_do_not_act():
    x = 1e-4 * np.sin(0.1 * np.arange(300))
    late = TABLE_I.with_effects(effect("Delay", delay=0.01), effect("DriveLag", time_constant=0.01))
    np.testing.assert_array_equal(
        simulate_imposed(late, x, 500.0).friction, simulate_imposed(TABLE_I, x, 500.0).friction
    )


@pytest.mark.parametrize("form", ["none", "NonlinearBristle", "MaxwellSlip", "DirectionAsymmetry"])
@pytest.mark.parametrize("speed", [1e-3, 1.0, 1e4])
def test_no_bristle_bends_beyond_its_yield_however_fast(form, speed):
    """|v| sigma0 dt/G up to 1e6 and above, with reversals at every other sample."""
    strengths = {"NonlinearBristle": {"hardening": 0.5}, "MaxwellSlip": {"share": 0.7}}.get(
        form, {"coulomb": 0.3}
    )
    drive = TABLE_I if form == "none" else TABLE_I.with_effects(effect(form, **strengths))
    x = np.cumsum(speed * 1e-2 * np.random.default_rng(3).normal(size=500))
    run = simulate_imposed(drive, x, 100.0)
    most = (
        1.5e-5 * np.max(np.asarray(drive.bristles().slack)) * (1.3 if form == "DirectionAsymmetry" else 1.0)
    )
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(run))
    assert float(jnp.max(jnp.abs(run.z))) <= most * (1.0 + 1e-12)


@pytest.mark.parametrize("form", ["none", "NonlinearBristle", "MaxwellSlip"])
def test_a_bent_bristle_at_rest_does_not_creep(form):
    drive = TABLE_I if form == "none" else TABLE_I.with_effects(effect(form))
    run = simulate_imposed(drive, np.full(500, 0.1), 10.0, z0=2e-6)
    assert np.all(np.asarray(run.z) == 2e-6)
    np.testing.assert_allclose(run.friction, 0.2, rtol=1e-14)


@pytest.mark.parametrize(("plant", "relative"), [("table_i", 0.9), ("rotary", 1.5), ("stage", 2.0)])
def test_it_gives_back_the_friction_of_a_simulated_drive(plant, relative):
    """From the position alone, at 20 kHz, within 1e-3 of break-away; with the velocity it knows, as well."""
    drive = PLANTS[plant]
    peak = relative * float(drive.friction.Fs / drive.motor_constant)
    run = simulate(drive, peak * np.sin(2 * np.pi * 5.0 * np.arange(8000) / 20_000.0), 20_000.0, substeps=4)
    fs = float(drive.friction.Fs)
    assert worst(simulate_imposed(drive, run.x, 20_000.0).friction, np.asarray(run.friction), fs) < 1e-3
    again = simulate_imposed(drive, run.x, 20_000.0, v=run.v)
    assert worst(again.friction, np.asarray(run.friction), fs) < 1e-3


NAMES = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
AT = np.linspace(0.0, 1.0, 301)
MOTION = 1e-4 * np.sin(9.0 * AT) * (1.0 - AT) + 2e-5 * np.sin(60.0 * AT)
UNITS = 0.02 * np.ones(len(STRENGTHS))


@eqx.filter_jit
def _by_parameters(logs, z0):
    law = LuGre(*(jnp.exp(logs) * jnp.array(numbers(TABLE_I)[1:])))
    return imposed_friction(Drive(1.0, law), MOTION, 1.0 / 300.0, z0)


@eqx.filter_jit
def _by_strengths(strengths, x=MOTION):
    return imposed_friction(with_every_effect(TABLE_I, strengths), x, 1.0 / 300.0, 1e-6)


_slopes = jax.jit(jax.jacfwd(_by_strengths))


def _differences(function, at, step):
    one = np.eye(len(at))
    low2, low, high, high2 = (np.stack([function(at + k * step * e) for e in one]) for k in (-2, -1, 1, 2))
    return ((8.0 * (high - low) - (high2 - low2)) / (12.0 * step)).T


def test_derivatives_by_every_parameter_and_by_the_start():
    def function(p):
        return _by_parameters(p[:6], 1e-5 * p[6])

    at = np.append(np.zeros(6), 0.4)
    forward = np.asarray(jax.jit(jax.jacfwd(function))(at))
    differences = _differences(function, at, 1e-4)
    assert np.max(np.abs(forward - differences)) < 1e-8 * np.max(np.abs(forward))
    assert np.all(np.max(np.abs(forward), axis=0) > 1e-8)


def test_derivatives_by_every_strength():
    forward = np.asarray(_slopes(UNITS, MOTION))
    differences = _differences(_by_strengths, UNITS, 1e-4)
    # A sample at which a play begins to slip, between two points of the difference, is a corner: one in a hundred.
    apart = np.quantile(np.abs(forward - differences), 0.97, axis=0)
    for name, error, ours, theirs in zip(STRENGTHS, apart, forward.T, differences.T, strict=True):
        assert error <= 1e-6 * np.max(np.abs(theirs)), name
        assert np.any(ours) == (name[0] not in ("Delay", "DriveLag")), name


def test_derivatives_at_rest_are_finite():
    still = np.zeros(301)
    slopes = _slopes(np.zeros(len(STRENGTHS)), still)
    assert bool(jnp.all(jnp.isfinite(slopes)))


def test_a_batch_of_drives_and_motions():
    masses, motions = jnp.array([1.0, 1.2]), jnp.stack([jnp.asarray(MOTION), jnp.asarray(2.0 * MOTION)])

    @eqx.filter_jit
    def force(share, x):
        return imposed_friction(
            Drive(1.0, TABLE_I.friction, 1.0, (effect("MaxwellSlip", share=share),)), x, 0.01, 0.0
        )

    together = jax.vmap(force)(0.5 * masses, motions)
    for k in range(2):
        np.testing.assert_allclose(together[k], force(0.5 * masses[k], motions[k]), rtol=1e-12, atol=1e-14)


def test_other_numbers_compile_nothing():
    noise = 1e-5 * np.random.default_rng(0).normal(size=(2, 307))

    def call(drive, k, rate):
        return lambda: simulate_imposed(drive, noise[k], rate, v=noise[1 - k], z0=1e-6 * k)

    assert programs(call(TABLE_I, 0, 200.0))
    assert programs(call(STAGE, 1, 1000)) == []
    assert programs(call(ROTARY, 1, 31.0)) == []


def test_what_does_not_fit_is_told():
    x = np.zeros(5)
    with pytest.raises(ValueError, match=r"`x` has shape \(5, 2\).*jax\.vmap"):
        simulate_imposed(TABLE_I, np.zeros((5, 2)), 200.0)
    with pytest.raises(ValueError, match="at least 2 samples"):
        simulate_imposed(TABLE_I, x[:1], 200.0)
    with pytest.raises(ValueError, match="one velocity for each position"):
        simulate_imposed(TABLE_I, x, 200.0, v=x[1:])
    with pytest.raises(InputError, match="`x`: sample 3 is nan"):
        simulate_imposed(TABLE_I, np.where(np.arange(5) == 3, np.nan, x), 200.0)
    with pytest.raises(InputError, match="`v`: sample 0 is inf"):
        simulate_imposed(TABLE_I, x, 200.0, v=np.where(np.arange(5) == 0, np.inf, x))
    for rate in (0.0, -200.0, np.nan):
        with pytest.raises(InputError, match=r"`sample_rate`: it is .* above zero"):
            simulate_imposed(TABLE_I, x, rate)


def test_it_asks_for_float64():
    with jax.enable_x64(False), pytest.raises(PrecisionError, match="jax_enable_x64"):
        simulate_imposed(TABLE_I, np.zeros(5), 200.0)
