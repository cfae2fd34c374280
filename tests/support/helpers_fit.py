"""Three short recordings of one shape, of a plant with known noise: what `fit` is tested on, compiled once."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from helpers_estimation import PLANT, VOLT, truth

from frictionjax.estimation import fit
from frictionjax.excitation import point_to_point, prbs
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation import simulate
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import advance

RATE, SAMPLES, SUBSTEPS = 1000.0, 4100, 2
NOISE = 2e-7
"""Standard deviation of the sensor's noise, rad: 6e-4 of the break-away deflection."""
PUSH = 1e-3
"""Standard deviation of the unmeasured force, held over each sample, N m: 1/500 of Coulomb friction."""
FINE = 1e-10
TRUTH = truth(PLANT)
NAMES = ("stick", "ramps", "moves")


def other_start(factors, drive=PLANT):
    """`drive` with some of its seven parameters multiplied by the `factors` of their names."""
    numbers = {name: value * factors.get(name, 1.0) for name, value in truth(drive).items()}
    inertia = numbers.pop("J")
    return Drive(inertia, type(drive.friction)(**numbers), drive.motor_constant, drive.effects)


def stick_input(rest=50):
    """Binary noise below break-away, after so many samples of `rest`."""
    stick = np.asarray(prbs(jax.random.key(0), SAMPLES, RATE, 200.0, 0.25 * VOLT))
    return np.where(np.arange(SAMPLES) < rest, 0.0, stick)


def ramps_input():
    """Ramps to above break-away in both directions, with a small loop between them."""
    corners = [
        (0, 0),
        (0.3, 0),
        (1.5, 1.15),
        (1.6, 0),
        (1.8, -0.4),
        (2.0, 0.3),
        (2.2, 0),
        (3.5, -1.15),
        (3.6, 0),
    ]
    times, levels = zip(*corners, strict=True)
    return VOLT * np.interp(np.arange(SAMPLES) / RATE, times, levels)


@eqx.filter_jit
def _servo(drive, reference, noise, push, gains):
    bristles, dt = drive.bristles(), jnp.asarray(1.0 / RATE)
    kp, kd = gains

    def sample(carry, inputs):
        state, error, slope = carry
        target, off, extra = inputs
        measured = state.x + off
        now = target - measured
        slope = slope + 0.3 * ((now - error) / dt - slope)
        u = kp * now + kd * slope
        force = drive.motor_constant * u + extra
        return (advance(drive, bristles, state, force, dt, SUBSTEPS), now, slope), (u, measured)

    zero = jnp.zeros(())
    start = (initial_state(drive, zero, zero, zero), zero, zero)
    return jax.lax.scan(sample, start, (reference, noise, push))[1]


def servo(name, reference, *, seed, drive=PLANT, noise=NOISE, push=PUSH, bandwidth=8.0):
    """A servo of `bandwidth` Hz follows `reference`; its input answers to the noisy measurement."""
    w = 2.0 * np.pi * bandwidth
    gains = tuple(jnp.asarray(g * drive.J / drive.motor_constant) for g in (w**2, 1.4 * w))
    rng = np.random.default_rng(seed)
    off, extra = noise * rng.standard_normal(SAMPLES), push * rng.standard_normal(SAMPLES)
    u, x = _servo(drive, jnp.asarray(reference), jnp.asarray(off), jnp.asarray(extra), gains)
    return Recording(name, RATE, np.asarray(u), np.asarray(x), loop="closed")


def driven(name, u, *, seed, drive=PLANT, noise=NOISE, push=PUSH, **state):
    """What an open loop measures for the input `u`."""
    rng = np.random.default_rng(seed)
    off, extra = noise * rng.standard_normal(SAMPLES), push * rng.standard_normal(SAMPLES)
    x = np.asarray(
        simulate(drive, u + extra / float(drive.motor_constant), RATE, substeps=SUBSTEPS, **state).x
    )
    return Recording(name, RATE, np.asarray(u, float), x + off)


def path(slow=0.3, fast=0.9):
    """A reference that goes to and fro without a rest, with two frequencies, Hz."""
    t = np.arange(SAMPLES) / RATE
    return 0.15 * (1.0 - np.cos(2.0 * np.pi * slow * t)) + 0.08 * (1.0 - np.cos(2.0 * np.pi * fast * t))


def experiment(seed=0, *, drive=PLANT, noise=NOISE, push=PUSH):
    """Noise in stick, break-away ramps, and moves in closed loop; everything shows in one of them."""
    common = {"drive": drive, "noise": noise, "push": push}
    return (
        driven("stick", stick_input(), seed=10 * seed + 1, **common),
        driven("ramps", ramps_input(), seed=10 * seed + 2, **common),
        servo("moves", path(), seed=10 * seed + 3, **common),
    )


def closed_experiment(seed=0, *, noise=NOISE):
    """Three recordings of a servo: shaken in stick, and two ways to and fro."""
    signs = np.sign(np.random.default_rng(77).standard_normal(SAMPLES // 5))
    shaken = 4e-4 * np.repeat(signs, 5) * (np.arange(SAMPLES) > 50)
    return (
        servo("shaken", shaken, seed=100 * seed + 1, noise=noise, bandwidth=15.0),
        servo("one way", path(), seed=100 * seed + 2, noise=noise),
        servo("other way", path(0.45, 1.3), seed=100 * seed + 3, noise=noise),
    )


def resting(name, *, seed):
    """A servo that moves three times and holds the machine, with a bent bristle, after each."""
    reference = point_to_point(SAMPLES, RATE, (0.3, -0.1, 0.02), (0.3, 0.5, 0.8), rests=0.5)
    return servo(name, np.asarray(reference), seed=seed)


NEAR = other_start({"J": 1.1, "sigma0": 0.9, "sigma2": 1.1, "Fc": 0.95, "vs": 0.9})
UNITS = {"force": "N*m", "position": "rad", "input": "V"}


def fit_near(data, start=NEAR, **choices):
    """`fit` from a fair start, with the `choices` of a test."""
    return fit(start, data, **({"encoder_step": FINE, "own_starts": False, "units": UNITS} | choices))
