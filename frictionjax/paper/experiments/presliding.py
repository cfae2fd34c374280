"""Fig. 2: a unit mass with the friction of Table I, loaded slowly to 95 % of its static friction and back."""

import itertools
import math

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.core import InputError
from frictionjax.excitation import presliding_loop
from frictionjax.physics import Drive
from frictionjax.simulation import simulate
from frictionjax.studies.level_sweep import table_one

LEVEL = 0.95


class Presliding(eqx.Module):
    """The cycle of Fig. 2, gone through twice, beside the closed forms for infinitely slow loading.

    **Attributes:**

    - `t`: time, s, shape `(n,)`.
    - `u`: applied force, N, shape `(n,)`.
    - `x`, `v`, `z`: position (m), velocity (m/s) and bristle deflection (m), shape `(n,)`.
    - `friction`: friction force, N, shape `(n,)`.
    - `closed_form`: position on the virgin curve and on every branch after it, from the force alone, m, shape `(n,)`.
    - `virgin`: position where the force first reaches its peak, m.
    - `virgin_expected`: the same in closed form, `Fs / sigma0 ln(1 / (1 - 0.95))`, m.
    - `branch_error`: largest distance between `x` and `closed_form`, m.
    - `x_after_cycle`, `z_after_cycle`: position and deflection after one whole cycle of the force, m.
    """

    t: Float[np.ndarray, " n"]
    u: Float[np.ndarray, " n"]
    x: Float[np.ndarray, " n"]
    v: Float[np.ndarray, " n"]
    z: Float[np.ndarray, " n"]
    friction: Float[np.ndarray, " n"]
    closed_form: Float[np.ndarray, " n"]
    virgin: float = eqx.field(static=True)
    virgin_expected: float = eqx.field(static=True)
    branch_error: float = eqx.field(static=True)
    x_after_cycle: float = eqx.field(static=True)
    z_after_cycle: float = eqx.field(static=True)


def presliding(
    drive: Drive | None = None, *, seconds: float = 80.0, sample_rate: float = 1000.0
) -> Presliding:
    """Run the experiment of Fig. 2.

    Infinitely slow loading never leaves `G(v) = Fs`, and (2) has a closed form from one reversal of the force at
    `(x_m, F_m)` to the next, with `s` the sign of the velocity (the virgin curve starts at `(0, 0)`):

        F = s Fs - (s Fs - F_m) exp(-sigma0 |x - x_m| / Fs)

    **Arguments:**

    - `drive`: a drive without effects; that of Table I when absent. Our copy of the paper lost the table: these are the
      numbers of Canudas de Wit et al. (1995), whose presliding experiment is the same.
    - `seconds`: length of the two cycles, s; the paper's is not said. The slower, the nearer to the closed forms.
    - `sample_rate`: samples per second.

    **Returns:** the `Presliding`.

    **Raises:** `InputError` when `drive` has effects, for which the closed forms are not valid; `PrecisionError` unless
        JAX computes in float64.
    """
    drive = table_one() if drive is None else drive
    if drive.effects:
        raise InputError(
            "`drive` has effects, and the closed forms are those of LuGre alone",
            cure="Leave `with_effects` out.",
        )
    friction = drive.friction
    Fs, sigma0 = float(friction.Fs), float(friction.sigma0)
    n = 8 * round(seconds * sample_rate / 8.0) + 1
    force = presliding_loop(n, sample_rate, LEVEL * Fs, cycles=2)
    run = simulate(drive, force / drive.motor_constant, sample_rate)
    u, x, z = (np.asarray(part) for part in (force, run.x, run.z[:, 0]))
    # Eight equal stretches: up, down twice, up twice, down twice, up.
    quarter = (n - 1) // 8
    closed = slow_position(u, Fs, sigma0)
    return Presliding(
        t=np.asarray(run.t),
        u=u,
        x=x,
        v=np.asarray(run.v),
        z=z,
        friction=np.asarray(run.friction),
        closed_form=closed,
        virgin=float(x[quarter]),
        virgin_expected=Fs / sigma0 * math.log(1.0 / (1.0 - LEVEL)),
        branch_error=float(np.max(np.abs(x - closed))),
        x_after_cycle=float(x[4 * quarter]),
        z_after_cycle=float(z[4 * quarter]),
    )


def slow_position(force: Float[np.ndarray, " n"], Fs: float, sigma0: float) -> Float[np.ndarray, " n"]:
    """Where infinitely slow loading brings a LuGre contact, branch by branch, in position units.

    **Arguments:**

    - `force`: starts at zero and stays below `Fs`, shape `(n,)`.
    - `Fs`: static friction, force.
    - `sigma0`: bristle stiffness, force per position unit.

    **Returns:** the position, shape `(n,)`.
    """
    turns = np.flatnonzero(np.diff(np.sign(np.diff(force)))) + 1
    edges = [0, *turns, force.size - 1]
    position = np.zeros(force.size)
    for first, last in itertools.pairwise(edges):
        way = np.sign(force[last] - force[first])
        part = slice(first, last + 1)
        stretch = np.log((way * Fs - force[first]) / (way * Fs - force[part]))
        position[part] = position[first] + way * Fs / sigma0 * stretch
    return position
