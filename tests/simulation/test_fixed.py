"""`simulate`: what must hold of any run, whatever the parameters."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import PLANTS, ROTARY, STAGE, TABLE_I
from hypothesis import given, settings
from hypothesis import strategies as st

from frictionjax.core import Parameter
from frictionjax.physics import Drive, LuGre
from frictionjax.physics.effects.base import About, AbstractDampingEffect
from frictionjax.physics.effects.micro_damping import MicroDamping
from frictionjax.simulation import simulate

RATE = 2000.0
N = 400
SINE = np.sin(2 * np.pi * 10.0 * np.arange(N) / RATE)
NOISE = np.random.default_rng(2002).normal(size=N)


def _input(drive, relative, shape=SINE):
    """An input that is `relative` times the break-away force at its peak (sine) or in rms (noise)."""
    return relative * float(drive.friction.Fs / drive.motor_constant) * shape


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize(("relative", "shape"), [(0.8, SINE), (3.0, SINE), (0.3, NOISE), (2.0, NOISE)])
def test_the_bristle_stays_within_its_yield(plant, relative, shape):
    drive = PLANTS[plant]
    run = simulate(drive, _input(drive, relative, shape), RATE)
    bend = float(drive.friction.Fs / drive.friction.sigma0)
    assert float(jnp.max(jnp.abs(run.z))) <= bend * (1.0 + 1e-3)
    assert all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(run))


def test_the_first_sample_is_the_initial_state():
    run = simulate(TABLE_I, np.zeros(3), RATE, x0=1e-3, v0=-0.02, z0=3e-6)
    assert (float(run.x[0]), float(run.v[0]), float(run.z[0, 0])) == (1e-3, -0.02, 3e-6)
    np.testing.assert_allclose(run.t, np.arange(3) / RATE, rtol=1e-15)
    assert run.z.shape == (3, 1)


@pytest.mark.parametrize("plant", PLANTS)
def test_at_rest_without_force_nothing_moves(plant):
    run = simulate(PLANTS[plant], np.zeros(N), RATE)
    for signal in (run.x, run.v, run.z, run.friction):
        assert not np.any(signal)


def test_a_bent_bristle_at_rest_does_not_creep():
    """Held by the force that bends it, the drive stays for 200 s: |v| is not smoothed, so nothing leaks."""
    z0 = 0.8 * 1.5e-5
    run = simulate(TABLE_I, np.full(N, 1e5 * z0), 2.0, x0=z0, z0=z0)
    np.testing.assert_allclose(run.x, z0, rtol=1e-12)
    np.testing.assert_allclose(run.z, z0, rtol=1e-12)


def test_free_decay_after_a_tiny_kick_is_the_linearised_one():
    v0 = 1e-8  # a deflection of 0.02 nm: the drive is linear there
    run = simulate(TABLE_I, np.zeros(N), 20_000.0, v0=v0)
    damping, stiffness = 0.5 * (1e5**0.5 + 0.4), 1e5
    frequency = np.sqrt(stiffness - damping**2)
    exact = v0 / frequency * np.exp(-damping * run.t) * np.sin(frequency * np.asarray(run.t))
    np.testing.assert_allclose(run.x, exact, atol=1e-4 * np.max(exact))


def test_a_thrown_mass_stops_and_stays():
    run = simulate(ROTARY, np.zeros(4 * N), RATE, v0=2.0)
    kinetic = 0.5 * 0.03 * 2.0**2
    # It slides at no more than Fs + sigma2 v and no less than Fc.
    assert kinetic / (0.62 + 0.06 * 2.0) < float(jnp.max(run.x)) < kinetic / 0.5
    assert float(jnp.max(jnp.abs(run.v[-N:]))) < 1e-9


@pytest.mark.parametrize(("plant", "relative"), [("table_i", 0.9), ("rotary", 0.7), ("stage", 2.0)])
def test_a_closed_cycle_dissipates(plant, relative):
    drive = PLANTS[plant]
    run = simulate(drive, _input(drive, relative), RATE, substeps=4)
    cycle = slice(N // 2, N - N // 4 + 1)  # after the first cycles
    x, friction = np.asarray(run.x)[cycle], np.asarray(run.friction)[cycle]
    work = np.trapezoid(friction, x)
    assert work > 0.05 * np.ptp(x) * np.ptp(friction)


def test_friction_balances_the_force_in_steady_motion():
    v = 0.5
    z = 0.5 / 2000.0  # G(v) = Fc far above vs
    run = simulate(ROTARY, np.full(N, (0.5 + 0.06 * v) / 16.0), RATE, v0=v, z0=z)
    np.testing.assert_allclose(run.v, v, rtol=1e-12)
    np.testing.assert_allclose(run.x, v * np.asarray(run.t), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(run.friction, 0.5 + 0.06 * v, rtol=1e-12)


def test_bristle_rates_far_above_the_step_rate_do_no_harm():
    """Reversals at sigma0 |v| h/Fc up to 200, with a sigma1 that turns a bristle thrown too far into a blow."""
    drive = Drive(0.0121, LuGre(6581.0, 8.9, 0.13, 0.074, 0.185, 0.43))
    u = 4.0 * np.random.default_rng(0).normal(size=(6, 800))
    coarse, fine = (
        jax.vmap(lambda force, n=substeps: simulate(drive, force, 2500.0, substeps=n).v)(u)
        for substeps in (1, 32)
    )
    assert float(jnp.max(jnp.abs(fine))) * 6581.0 / 0.074 / 2500.0 > 100.0
    error = jnp.std(coarse - fine, axis=1) / jnp.std(fine, axis=1)
    assert float(jnp.max(error)) < 0.05


def test_batches_over_drives_and_inputs():
    u = np.stack([_input(TABLE_I, 0.5), _input(TABLE_I, 1.4, NOISE)])
    masses = jnp.array([1.0, 1.3])

    def run(mass, u):
        return simulate(Drive(mass, TABLE_I.friction), u, RATE).x

    batched = jax.vmap(run)(masses, jnp.asarray(u))
    for k in range(2):
        np.testing.assert_allclose(batched[k], run(masses[k], u[k]), rtol=1e-9, atol=1e-18)


def test_under_jit_it_gives_the_same():
    u = jnp.asarray(_input(STAGE, 2.0))
    inside = jax.jit(lambda force: simulate(STAGE, force, RATE).x)(u)
    np.testing.assert_allclose(inside, simulate(STAGE, u, RATE).x, rtol=1e-10, atol=1e-18)


def test_new_numbers_do_not_compile_again():
    count = 0

    @jax.custom_jvp
    def seen(v):
        nonlocal count
        count += 1
        return v

    class Counting(AbstractDampingEffect):
        """An effect of nothing that counts how often it is traced."""

        name: ClassVar[str] = "counting"
        about: ClassVar[About] = MicroDamping.about
        strengths: ClassVar[tuple[Parameter, ...]] = ()
        nuisances: ClassVar[tuple[Parameter, ...]] = ()

        def damping(self, friction, v):
            return seen(jnp.ones_like(v))

    seen.defjvp(lambda primal, tangent: (seen(*primal), tangent[0]))
    law, counting = TABLE_I.friction, (Counting(),)
    simulate(Drive(1.0, law, effects=counting), np.zeros(N), RATE)
    traced = count
    assert traced > 0
    stiffer = eqx.tree_at(lambda friction: friction.sigma0, law, law.sigma0 * 1.1)
    simulate(Drive(2.0, stiffer, motor_constant=3, effects=counting), SINE, 1000, x0=1e-6, v0=0.1, z0=1)
    assert count == traced
    simulate(Drive(1.0, law, effects=counting), np.zeros(N + 1), RATE)  # another length does
    assert count > traced


@pytest.mark.parametrize("shape", [(), (3, 4)])
def test_an_input_of_another_rank_is_refused(shape):
    with pytest.raises(ValueError, match=r"`u` has shape .*jax\.vmap"):
        simulate(TABLE_I, np.zeros(shape), RATE)


LOGS = [("J", -1.0, 1.0), ("sigma0", 3.0, 6.0), ("damping", -1.0, 0.3), ("sigma2", -1.0, 1.0)]
LOGS += [("Fc", -1.0, 1.0), ("ratio", 0.0, 0.3), ("vs", -3.5, -1.0), ("force", -1.0, 0.5)]


@settings(max_examples=40, derandomize=True)
@given(
    logs=st.tuples(*(st.floats(low, high) for _, low, high in LOGS)),
    seed=st.integers(0, 9),
    noisy=st.booleans(),
)
def test_any_admissible_drive_stays_finite_and_bounded(logs, seed, noisy):
    value = {name: 10.0**log for (name, _, _), log in zip(LOGS, logs, strict=True)}
    sigma1 = value["damping"] * 2.0 * np.sqrt(value["sigma0"] * value["J"])
    friction = LuGre(
        value["sigma0"], sigma1, value["sigma2"], value["Fc"], value["Fc"] * value["ratio"], value["vs"]
    )
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, N)
    wave = np.sign(SINE) if seed % 2 else SINE
    u = value["force"] * value["Fc"] * value["ratio"] * (noise if noisy else wave)
    run = simulate(Drive(value["J"], friction), u, RATE)
    bend = value["Fc"] * value["ratio"] / value["sigma0"]
    assert bool(jnp.all(jnp.isfinite(run.x)))
    assert float(jnp.max(jnp.abs(run.z))) <= 3.0 * bend
    # Never faster than the force could make it without friction.
    assert float(jnp.max(jnp.abs(run.v))) <= 1.5 * np.max(np.abs(u)) / value["J"] * N / RATE


@pytest.mark.parametrize(("plant", "relative"), [("table_i", 0.9), ("rotary", 1.5), ("stage", 3.0)])
def test_the_number_of_steps_is_found_and_keeps_its_word(plant, relative):
    """The error is that against sixteen times as many steps, by no more than the estimate."""
    drive = PLANTS[plant]
    u, step = _input(drive, relative), 1e-3 * float(drive.friction.Fs / drive.friction.sigma0)
    run = simulate(drive, u, RATE, substeps="auto", encoder_step=step)
    assert run.substeps is not None and run.error is not None
    assert run.error < 0.1 * step
    finer = simulate(drive, u, RATE, substeps=16 * run.substeps)
    assert float(jnp.max(jnp.abs(run.x - finer.x))) < 1.5 * run.error
    # A run with half as many steps would not do: the number found is not larger than it must be.
    if run.substeps > 1:
        half = simulate(drive, u, RATE, substeps=run.substeps // 2)
        assert float(jnp.max(jnp.abs(half.x - finer.x))) > 0.05 * step


def test_a_tolerance_that_cannot_be_met_and_a_missing_one_are_refused():
    u = _input(TABLE_I, 2.0)
    with pytest.raises(ValueError, match="needs a positive `encoder_step` or `tolerance`"):
        simulate(TABLE_I, u, RATE, substeps="auto")
    with pytest.raises(ValueError, match="raise `tolerance`"):
        simulate(TABLE_I, u, RATE, substeps="auto", tolerance=1e-18)
    with pytest.raises(ValueError, match="outside jit"):
        jax.jit(lambda force: simulate(TABLE_I, force, RATE, substeps="auto", tolerance=1e-6).x)(u)
