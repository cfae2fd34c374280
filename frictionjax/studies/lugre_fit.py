"""Least squares of the full LuGre drive on recorded positions, of many draws at once.

All draws of a batch take the same few Gauss-Newton steps, each with one evaluation, and convergence is
checked afterwards: a batch with individual stopping would wait for its slowest member. No step is rejected. The minimum
of these problems is narrow and curved: the first full step raises the cost twentyfold and the third reaches the
minimum, while steps that must lower the cost converge slowly.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.physics import Drive, LuGre
from frictionjax.simulation.fixed import initial_state
from frictionjax.simulation.ros2 import DriveState, advance
from frictionjax.studies.gauss_newton import ENOUGH, inverse, step

NAMES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
"""What is fitted, as logarithms, in this order."""

APPROACH = (0.1,) * 6 + (0.03, 0.01, 1e-3, 1e-5)
"""From a start tens of percent off to where least squares on a break-away converges: see `fit_positions`."""

PLAUSIBLE = 0.3  # standard deviation of the weak prior on each logarithm's step, while `relative` is positive
SUBSTEPS = 2


class Records(NamedTuple):
    """One experiment from rest in every draw: input `u` (force) and position `x`, `(lanes, n)`, every `dt` s."""

    u: Float[Array, "lanes n"]
    x: Float[Array, "lanes n"]
    dt: Float[Array, ""]


class LeastSquaresFits(NamedTuple):
    """Least-squares fits.

    **Attributes:**

    - `theta`: logarithms of the parameters, shape `(lanes, 7)`, in the order of `NAMES`.
    - `covariance`: theirs, with the noise variance from the residuals, shape `(lanes, 7, 7)`.
    - `variance`: of the noise, position units squared, shape `(lanes,)`.
    - `converged`: whether the next step is a small part of a standard error, shape `(lanes,)`.
    """

    theta: Float[Array, "lanes 7"]
    covariance: Float[Array, "lanes 7 7"]
    variance: Float[Array, " lanes"]
    converged: Bool[Array, " lanes"]


def theta_of(drive: Drive) -> Float[Array, " 7"]:
    """Logarithms of the parameters of `drive`, shape `(7,)`, in the order of `NAMES`."""
    return jnp.log(jnp.stack([drive.J, *(getattr(drive.friction, name) for name in NAMES[1:])]))


def positions(theta: Float[Array, " 7"], u: Float[Array, " n"], dt: Float[Array, ""]) -> Float[Array, " n"]:
    """Free run from rest of the drive with logarithms `theta` under the force `u`, held for `dt` s; shape `(n,)`."""
    J, sigma0, sigma1, sigma2, Fc, Fs, vs = jnp.exp(theta)
    drive = Drive(J=J, friction=LuGre(sigma0=sigma0, sigma1=sigma1, sigma2=sigma2, Fc=Fc, Fs=Fs, vs=vs))
    bristles = drive.bristles()
    zero = jnp.zeros(())

    def sample(state: DriveState, force: Float[Array, ""]) -> tuple[DriveState, Float[Array, ""]]:
        # The cheaper derivatives of the scheme: they are within 0.2 % of the exact ones here.
        return advance(drive, bristles, state, force, dt, SUBSTEPS, exact_derivative=False), state.x

    return jax.lax.scan(sample, initial_state(drive, zero, zero, zero), u)[1]


@jax.jit
def equations(
    theta: Float[Array, "lanes 7"],
    records: Records,
    noise: Float[Array, " lanes"],
    relative: Float[Array, ""],
) -> tuple[Float[Array, " lanes"], Float[Array, "lanes 7 7"], Float[Array, "lanes 7"]]:
    """Cost, Gauss-Newton matrix and gradient of each draw at `theta`.

    Of the residuals of `records` over `noise + relative |x|`.
    """

    def one(
        theta: Float[Array, " 7"], u: Float[Array, " n"], x: Float[Array, " n"], noise: Float[Array, ""]
    ) -> tuple[Float[Array, ""], Float[Array, "7 7"], Float[Array, " 7"]]:
        def along(tangent: Float[Array, " 7"]) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
            return jax.jvp(lambda p: positions(p, u, records.dt), (theta,), (tangent,))

        # Not `linearize`, which would store every coefficient of the whole run.
        model, columns = jax.vmap(along, out_axes=(None, 0))(jnp.eye(theta.size))
        weight = 1.0 / (noise + relative * jnp.abs(x))
        miss, columns = weight * (x - model), columns * weight[None, :]
        return miss @ miss, columns @ columns.T, columns @ miss

    return jax.vmap(one)(theta, records.u, records.x, noise)


def fit_positions(
    theta: Float[Numbers, "lanes 7"], records: Sequence[Records], relative: Sequence[float]
) -> LeastSquaresFits:
    """Least squares from `theta` on all `records` together, one step for each entry of `relative`.

    The machine moves by micrometres before break-away and by centimetres after it. In the first steps, the
    standard deviation of each sample is the noise plus `relative` times its own position, so that sticking and sliding
    have equal weight; the zeros at the end are steps of ordinary least squares.
    """
    noise = _noise(records[0].x)
    for part in (*relative, 0.0):
        found = [equations(theta, record, noise, jnp.asarray(part)) for record in records]
        cost, normal, gradient = (sum(parts[1:], parts[0]) for parts in zip(*found, strict=True))
        last, move = theta, _steps(normal, gradient, jnp.asarray(1.0 / PLAUSIBLE**2 if part > 0.0 else 0.0))
        theta = theta + move
    return _finish(last, cost, normal, gradient, noise, sum(record.x.shape[1] for record in records))


@jax.jit
def _noise(x: Float[Array, "lanes n"]) -> Float[Array, " lanes"]:
    """The noise, from the second differences of the first quarter of a break-away, where the machine still sticks."""
    early = x[:, : x.shape[1] // 4]
    return jnp.sqrt(jnp.mean((early[:, 2:] - 2.0 * early[:, 1:-1] + early[:, :-2]) ** 2, axis=1) / 6.0)


@jax.jit
def _steps(
    normal: Float[Array, "lanes 7 7"], gradient: Float[Array, "lanes 7"], prior: Float[Array, ""]
) -> Float[Array, "lanes 7"]:
    return jax.vmap(step)(normal + (prior * jnp.eye(normal.shape[-1]))[None], gradient)


@jax.jit
def _finish(
    theta: Float[Array, "lanes 7"],
    cost: Float[Array, " lanes"],
    normal: Float[Array, "lanes 7 7"],
    gradient: Float[Array, "lanes 7"],
    noise: Float[Array, " lanes"],
    count: int | Int[Array, ""],
) -> LeastSquaresFits:
    freedom = (count - theta.shape[1]) * jnp.ones(())
    excess = cost / freedom
    left = jnp.sum(gradient * jax.vmap(step)(normal, gradient), axis=1)
    covariance = excess[:, None, None] * jax.vmap(inverse)(normal)
    return LeastSquaresFits(theta, covariance, excess * noise**2, left < ENOUGH * excess)
