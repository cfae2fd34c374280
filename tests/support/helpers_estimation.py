"""Short simulated recordings of plants with known parameters: what fits and diagnoses are tested on."""

from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from helpers_plants import ROTARY, effect

from frictionjax.core import silent
from frictionjax.diagnosis.base_model.fit_base import fit_base
from frictionjax.estimation.data.batch import make_batch
from frictionjax.excitation import gaussian_noise, point_to_point, prbs
from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import simulate
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import advance

RATE = 2000.0
NOISE = 1e-6
"""Standard deviation of the sensor's noise, rad: 3e-3 of the break-away deflection of the plant below."""
FINE = 1e-9
"""An encoder step that is not felt beside NOISE."""
PLANT = ROTARY
VOLT = float(PLANT.friction.Fs / PLANT.motor_constant)
"""Input that breaks the plant away."""
ARM = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")


def truth(drive):
    """The seven base parameters of a drive by name."""
    friction = drive.friction
    return {"J": float(drive.J)} | {name: float(getattr(friction, name)) for name in ARM[1:]}


def open_loop(name, u, *, seed, drive=PLANT, role="fit", noise=NOISE, substeps=1, **state):
    """What an open loop measures for the input `u`, from rest or from `state` (`x0`, `v0`, `z0`)."""
    x = np.asarray(simulate(drive, u, RATE, substeps=substeps, **state).x)
    measured = x + noise * np.random.default_rng(seed).standard_normal(x.size)
    return Recording(name, RATE, np.asarray(u, float), measured, role=role)


@eqx.filter_jit
def _servo(drive, reference, disturbance, gains, late, substeps):
    bristles, dt = drive.bristles(), jnp.asarray(1.0 / RATE)
    kp, kd = gains

    def sample(carry, inputs):
        state, error, slope, waiting = carry
        target, noise = inputs
        measured = state.x + noise
        now = target - measured
        slope = slope + 0.5 * ((now - error) / dt - slope)
        u = kp * now + kd * slope
        waiting = jnp.append(waiting, u)
        force = drive.motor_constant * waiting[0]
        return (advance(drive, bristles, state, force, dt, substeps), now, slope, waiting[1:]), (u, measured)

    zero = jnp.zeros(())
    start = (initial_state(drive, zero, zero, zero), zero, zero, jnp.zeros(late))
    return jax.lax.scan(sample, start, (reference, disturbance))[1]


def closed_loop(name, reference, *, seed, drive=PLANT, role="fit", noise=NOISE, late=0, substeps=1):
    """A servo of 10 Hz follows `reference`; its input answers to the noisy measurement, as on a machine.

    The input reaches the drive `late` samples after it is recorded. Effects on the input are not simulated here.
    """
    w = 2.0 * np.pi * 10.0
    gains = tuple(jnp.asarray(g * drive.J / drive.motor_constant) for g in (w**2, 1.4 * w))
    disturbance = noise * np.random.default_rng(seed).standard_normal(len(reference))
    u, measured = _servo(drive, jnp.asarray(reference), jnp.asarray(disturbance), gains, late, substeps)
    return Recording(name, RATE, np.asarray(u), np.asarray(measured), role=role, loop="closed")


def stick_noise(seconds=2.2, *, level=0.15, seed=0):
    """Binary noise well below break-away."""
    return np.asarray(prbs(jax.random.key(seed), round(seconds * RATE), RATE, 400.0, level * VOLT))


def large_noise(seconds=2.2, *, level=0.4, seed=0):
    """Gaussian noise whose peaks break away now and then."""
    return np.asarray(gaussian_noise(jax.random.key(seed), round(seconds * RATE), RATE, 300.0, level * VOLT))


def break_away(seconds=2.2):
    """Ramps to just above break-away in both directions, with a small loop between them."""
    corners = [
        (0.0, 0.0),
        (0.1, 0.0),
        (0.8, 1.1),
        (0.9, 0.0),
        (1.0, -0.4),
        (1.1, 0.3),
        (1.2, 0.0),
        (1.9, -1.1),
    ]
    times, levels = zip(*corners, (2.0, 0.0), (seconds, 0.0), strict=True)
    return VOLT * np.interp(np.arange(round(seconds * RATE)) / RATE, times, levels)


def moves(seconds=2.4, positions=(0.3, -0.1, 0.02), durations=(0.3, 0.4, 0.6)):
    """Point-to-point moves, fast and slow."""
    return np.asarray(point_to_point(round(seconds * RATE), RATE, positions, durations, rests=0.2))


def experiment(*, drive=PLANT, late=0, seed=0, noise=NOISE, substeps=4, seconds=4.0):
    """Four recordings that show every base parameter; the input acts `late` samples after it is recorded.

    `seconds` is the length of the two noise recordings.
    """
    delayed = drive.with_effects(effect("Delay", delay=late / RATE)) if late else drive
    common = {"noise": noise, "substeps": substeps}
    stick, loud = stick_noise(seconds, seed=seed), large_noise(seconds, seed=seed)
    return (
        open_loop("stick", stick, seed=10 * seed + 1, drive=delayed, **common),
        open_loop("ramps", break_away(), seed=10 * seed + 2, drive=delayed, **common),
        open_loop("loud", loud, seed=10 * seed + 3, drive=delayed, **common),
        closed_loop("moves", moves(), seed=10 * seed + 4, drive=drive, late=late, **common),
    )


def small_case(*, drive=PLANT, late=0, seed=0, seconds=4.0):
    """The experiment as a case, with other moves held out."""
    more = moves(positions=(-0.25, 0.1, 0.07), durations=(0.3, 0.5, 0.4))
    held = closed_loop("others", more, seed=10 * seed + 5, drive=drive, late=late, role="holdout")
    plant = Plant(
        motor_constant=float(drive.motor_constant),
        position_unit="rad",
        force_unit="N*m",
        input_unit="V",
        encoder_step=FINE,
    )
    return Case("small", plant, (*experiment(drive=drive, late=late, seed=seed, seconds=seconds), held))


def base_fit(starts, recordings, *, progress=silent, known_inertia=False, encoder_step=FINE):
    """The base model fitted robustly to those of the `recordings` that are not held out: a `Model`."""
    held_out = np.array([recording.role == "holdout" for recording in recordings])
    batch = make_batch(tuple(recordings), encoder_step=encoder_step)
    with ThreadPoolExecutor(2) as executor:
        return fit_base(
            starts, batch, held_out, executor, progress, fixed=frozenset({"J"} if known_inertia else ())
        )
