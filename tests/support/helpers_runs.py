"""Runs of one program each for all numbers of steps, and for all lengths: what is compared is compiled once."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from frictionjax.physics import mean_of
from frictionjax.simulation.fixed import initial_state, run_free
from frictionjax.simulation.reference import scaled_rates


@eqx.filter_jit
def _run(drive, u, dt, start, substeps):
    return run_free(drive, u, dt, start, substeps)


def in_steps(drive, u, rate, substeps, *, v0=0.0, z0=0.0):
    """What `simulate` gives in `substeps` steps a sample, whose number is data here: they share a program."""
    start = tuple(jnp.asarray(float(number)) for number in (0.0, v0, z0))
    return _run(drive, jnp.asarray(u), jnp.asarray(1.0 / rate), start, jnp.asarray(substeps))


@eqx.filter_jit
def _begin(drive, u, dt):
    """Force of each sample, its rise within the sample, and the states at the first sample in terms of Fs/sigma0."""
    force, zero = drive.applied_force(u, dt), jnp.zeros(())
    hidden = initial_state(drive, zero, zero, zero).hidden * drive.friction.sigma0 / drive.friction.Fs
    return mean_of(force), getattr(force, "rise", jnp.zeros(u.shape)), hidden


@functools.cache
def _programs(structure):
    """The rates and their derivatives by the states, of all drives of one structure: their numbers are one array."""

    def of(program):
        return jax.jit(lambda numbers, *now: program(jax.tree.unflatten(structure, list(numbers)), *now))

    return of(scaled_rates), of(jax.jacfwd(scaled_rates, argnums=1))


def position_by_scipy(drive, u, rate, rtol=1e-8, atol=1e-10):
    """Position at the samples from rest: the equations of `simulate_reference`, solved by scipy's LSODA.

    It starts again at every sample, so that no change of the input is stepped over. To compile the rates takes a small
    part of what an adaptive method in JAX takes.
    """
    dt = 1.0 / rate
    leaves, structure = jax.tree.flatten(drive)
    numbers, programs = np.array([float(leaf) for leaf in leaves]), _programs(structure)
    mean, rise, hidden = (np.asarray(part) for part in _begin(drive, jnp.asarray(u), jnp.asarray(dt)))
    state = np.concatenate([np.zeros(2 + drive.bristle_count), hidden])

    def call(program, t, scaled, own_mean, own_rise):
        return np.asarray(program(numbers, scaled, own_mean + own_rise * (t / dt - 0.5)))

    field, jacobian = (functools.partial(call, program) for program in programs)
    positions = [0.0]
    for held in zip(mean[:-1], rise[:-1], strict=True):
        solution = solve_ivp(field, (0.0, dt), state, "LSODA", jac=jacobian, args=held, rtol=rtol, atol=atol)
        assert solution.success
        state = solution.y[:, -1]
        positions.append(state[0])
    return np.array(positions) * float(drive.friction.Fs / drive.friction.sigma0)
