"""`simulate_imposed`: friction under an imposed motion, against scipy, closed forms and `simulate`."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_imposed import BEND, MOTION, differences, reference, sine, worst, zigzag
from helpers_lugre_numpy import numbers
from helpers_plants import PLANTS, ROTARY, STAGE, TABLE_I, effect
from helpers_traces import programs

from frictionjax.core import InputError, PrecisionError
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate, simulate_imposed
from frictionjax.simulation.imposed import imposed_friction


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


@eqx.filter_jit
def _by_parameters(logs, z0):
    law = LuGre(*(jnp.exp(logs) * jnp.array(numbers(TABLE_I)[1:])))
    return imposed_friction(Drive(1.0, law), MOTION, 1.0 / 300.0, z0)


def test_derivatives_by_every_parameter_and_by_the_start():
    def function(p):
        return _by_parameters(p[:6], 1e-5 * p[6])

    at = np.append(np.zeros(6), 0.4)
    forward = np.asarray(jax.jit(jax.jacfwd(function))(at))
    central = differences(function, at, 1e-4)
    assert np.max(np.abs(forward - central)) < 1e-8 * np.max(np.abs(forward))
    assert np.all(np.max(np.abs(forward), axis=0) > 1e-8)


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


def test_what_does_not_fit_is_refused():
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
