"""`simulate_batch`: the same numbers as one run after the other, however the batch is cut."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_plants import ROTARY, TABLE_I, effect

import frictionjax.simulation.batch as module
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation import simulate, simulate_batch

RATE, N = 2000.0, 120
U = 1.5 * np.sin(2 * np.pi * 25.0 * np.arange(N) / RATE)
MASSES = np.linspace(0.7, 1.4, 13)


def _drives(masses=MASSES):
    return Drive(masses, TABLE_I.friction)


def _one_by_one(masses=MASSES, u=U):
    rows = np.broadcast_to(u, (len(masses), N))
    return np.stack(
        [simulate(Drive(m, TABLE_I.friction), row, RATE).x for m, row in zip(masses, rows, strict=True)]
    )


def last_and_peak(run):
    return {"last": run.x[-1], "peak": jnp.max(jnp.abs(run.v))}


def test_a_batch_is_its_runs():
    x = simulate_batch(_drives(), U, RATE)
    assert isinstance(x, np.ndarray)
    np.testing.assert_allclose(x, _one_by_one(), rtol=1e-9, atol=1e-18)


def test_inputs_and_starts_may_differ_from_drive_to_drive():
    rng = np.random.default_rng(1)
    u = U * rng.uniform(0.5, 1.5, (13, 1))
    x0, v0, z0 = 1e-3 * rng.normal(size=(3, 13))
    x = simulate_batch(TABLE_I, u, RATE, x0=x0, v0=v0, z0=1e-3 * z0, substeps=1)
    for k in (0, 5, 12):
        run = simulate(TABLE_I, u[k], RATE, x0=x0[k], v0=v0[k], z0=1e-3 * z0[k], substeps=1)
        np.testing.assert_allclose(x[k], run.x, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("drives", [1, 2, 3, 13])
@pytest.mark.parametrize("lanes", [1, 2, 5, 64])
def test_the_cut_into_blocks_does_not_show(monkeypatch, drives, lanes):
    monkeypatch.setattr(module, "_LANES", lanes)
    x = simulate_batch(_drives(MASSES[:drives]), U, RATE)
    np.testing.assert_allclose(x, _one_by_one(MASSES[:drives]), rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("memory", [0.0, 8.0 * N * 5, 1e9])
def test_a_batch_beyond_memory_is_cut_into_pieces_that_cover_it(memory):
    seen = []
    x = simulate_batch(_drives(), U, RATE, memory=memory, progress=lambda stage, part: seen.append(part))
    np.testing.assert_allclose(x, _one_by_one(), rtol=1e-9, atol=1e-18)
    assert seen[-1] == 1.0
    assert len(seen) == {0.0: 7, 8.0 * N * 5: 3, 1e9: 1}[memory]  # two devices: pieces of 2, of 6, of all


def test_what_is_kept_is_what_is_asked_for():
    kept = simulate_batch(_drives(), U, RATE, of=last_and_peak)
    np.testing.assert_allclose(kept["last"], _one_by_one()[:, -1], rtol=1e-9, atol=1e-18)
    run = simulate(_drives(MASSES[3]), U, RATE)
    assert kept["peak"][3] == pytest.approx(float(jnp.max(jnp.abs(run.v))), rel=1e-9)


def test_effects_and_their_strengths_may_differ():
    shares = jnp.linspace(0.0, 0.8, 4)
    drives = eqx.tree_at(lambda d: d.effects[0].share, ROTARY.with_effects(effect("MaxwellSlip")), shares)
    x = simulate_batch(drives, 0.02 * U, RATE)
    for k in range(4):
        alone = ROTARY.with_effects(effect("MaxwellSlip", share=shares[k]))
        np.testing.assert_allclose(x[k], simulate(alone, 0.02 * U, RATE).x, rtol=1e-9, atol=1e-15)


def test_inside_a_derivative_it_is_a_jax_array_and_agrees():
    def last(masses):
        return simulate_batch(_drives(masses), U, RATE, of=last_and_peak)["last"]

    slope = jnp.diag(jax.jit(jax.jacfwd(last))(jnp.asarray(MASSES[:3])))
    alone = jax.jit(jax.grad(lambda m: simulate(Drive(m, TABLE_I.friction), U, RATE).x[-1]))
    np.testing.assert_allclose(slope, [alone(m) for m in MASSES[:3]], rtol=1e-8)


@functools.cache
def _held(parameters, drives):
    """Bytes that a compiled derivative by `parameters` common factors holds, beside its inputs and its result."""
    names = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")[:parameters]

    def misfit(factors, masses):
        friction = eqx.tree_at(
            lambda f: [getattr(f, name) for name in names],
            TABLE_I.friction,
            [getattr(TABLE_I.friction, name) * factor for name, factor in zip(names, factors, strict=True)],
        )
        return jnp.sum(simulate_batch(Drive(masses, friction), U, RATE, of=last_and_peak)["last"] ** 2)

    def gradient(factors, masses):
        return jax.lax.map(
            lambda one: jax.jvp(lambda f: misfit(f, masses), (factors,), (one,))[1], jnp.eye(parameters)
        )

    program = jax.jit(gradient).lower(jnp.ones(parameters), jnp.ones(drives)).compile()
    return program.memory_analysis().temp_size_in_bytes


def test_the_memory_of_a_derivative_is_flat_in_parameters_and_drives():
    """One tangent after the other, one block of drives after the other; reverse mode would hold every step of all."""
    assert _held(6, 256) < 1.05 * _held(1, 256)
    assert _held(6, 1024) < 1.3 * _held(6, 256)


def test_results_beyond_the_machine_are_refused_before_anything_runs():
    def far_too_much(run):
        return jnp.zeros(2**50) + run.x[-1]

    with pytest.raises(ValueError, match="let `of` return less"):
        simulate_batch(_drives(), U, RATE, of=far_too_much)


def test_nothing_that_differs_is_refused():
    with pytest.raises(ValueError, match="Nothing differs from drive to drive"):
        simulate_batch(TABLE_I, U, RATE)


def test_different_lengths_are_refused():
    with pytest.raises(ValueError, match=r"lengths \[3, 13\]"):
        simulate_batch(_drives(), U, RATE, x0=np.zeros(3))


def test_an_input_of_another_rank_is_refused():
    with pytest.raises(ValueError, match=r"`u` has shape \(2, 3, 4\)"):
        simulate_batch(
            Drive(LuGre(1, 1, 1, 1, 1, 1).Fc * jnp.ones(2), TABLE_I.friction), np.zeros((2, 3, 4)), RATE
        )
