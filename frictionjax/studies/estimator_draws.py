"""The experiments of the comparison of estimators: drawn, fitted and bounded, each for a batch of draws at once."""

import itertools
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from time import perf_counter
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from frictionjax.core.arrays import Numbers
from frictionjax.core.compile_time import CompileClock
from frictionjax.excitation import prbs, ramp
from frictionjax.frequency import estimate_frf
from frictionjax.studies.gauss_newton import inverse
from frictionjax.studies.lugre_fit import (
    APPROACH,
    LeastSquaresFits,
    Records,
    equations,
    fit_positions,
    positions,
)
from frictionjax.studies.response_fit import Band, fit_response

NOISE_RATE, NOISE_SAMPLES, SEGMENT = 2000.0, 4096, 1024
RAMP_RATE, RAMP_SAMPLES, RAMP_PEAK = 1000.0, 1000, 2.0
BANDWIDTH = 500.0
BAND = Band(3.0, 150.0, SEGMENT, 1 + (NOISE_SAMPLES - SEGMENT) // (SEGMENT // 2), NOISE_RATE)
START_SPREAD = 0.1  # starts lie this far from the truth, as a logarithm, at most
BREAKAWAY_STEPS, JOINT_STEPS = 5, 4


Lanes = Mapping[str, Float[Numbers, "lanes ..."]]
"""What `draw` makes, by name: one row for each draw."""


class Estimates(NamedTuple):
    """The estimates of one estimator on a batch of draws.

    **Attributes:**

    - `values`: J, sigma0, sigma1 + sigma2, sigma2, Fc, Fs, vs; shape `(lanes, 7)`, NaN where it gives none.
    - `stderr`: their standard errors, shape `(lanes, 7)`.
    - `converged`: whether it converged, shape `(lanes,)`.
    """

    values: Float[Array, "lanes 7"]
    stderr: Float[Array, "lanes 7"]
    converged: Bool[Array, " lanes"]


def break_away(level: Float[Array, ""]) -> Float[Array, " n"]:
    """The break-away experiment: a ramp of the force to twice `level`, the static friction."""
    return ramp(RAMP_SAMPLES, RAMP_RATE, RAMP_PEAK * level)


@jax.jit
def draw(
    theta: Float[Array, " 7"],
    level: Float[Array, ""],
    keys: Key[Array, " lanes"],
    sigma: Float[Array, " lanes"],
) -> dict[str, Float[Array, "lanes ..."]]:
    """One experiment for each of `keys`, shape `(lanes,)`, on the drive with logarithms `theta`.

    A noise experiment at the rms `level` (force) and a break-away by ramp, both with position noise of standard
    deviation `sigma`, shape `(lanes,)`; and a start.
    """

    def one(key: Key[Array, ""], sigma: Float[Array, ""]) -> dict[str, Float[Array, "..."]]:
        part = jax.random.split(key, 4)
        fast = prbs(part[0], NOISE_SAMPLES, NOISE_RATE, BANDWIDTH, level)
        x = positions(theta, fast, jnp.asarray(1.0 / NOISE_RATE))
        return {
            "fast_u": fast,
            "fast_x": x + sigma * jax.random.normal(part[1], x.shape),
            "slow_noise": sigma * jax.random.normal(part[2], (RAMP_SAMPLES,)),
            "start": theta + START_SPREAD * jax.random.uniform(part[3], theta.shape, minval=-1.0, maxval=1.0),
        }

    lanes = jax.vmap(one)(keys, sigma)
    slow = positions(theta, break_away(jnp.exp(theta[5])), jnp.asarray(1.0 / RAMP_RATE))
    lanes["slow_x"] = slow[None, :] + lanes.pop("slow_noise")
    return lanes


def _slow(theta: Float[Array, " 7"], lanes: Lanes) -> Records:
    u = break_away(jnp.exp(theta[5]))
    x = lanes["slow_x"]
    return Records(jnp.broadcast_to(u, x.shape), x, jnp.asarray(1.0 / RAMP_RATE))


def _fast(lanes: Lanes) -> Records:
    return Records(lanes["fast_u"], lanes["fast_x"], jnp.asarray(1.0 / NOISE_RATE))


@jax.jit
def respond(lanes: Lanes) -> tuple[Estimates, Estimates]:
    """Sanathanan-Koerner and maximum likelihood on the frequency response of each noise experiment in `lanes`."""

    def one(u: Float[Array, " n"], x: Float[Array, " n"]) -> tuple[Estimates, Estimates]:
        frf = estimate_frf(u, x, NOISE_RATE, segment=SEGMENT)
        missing = jnp.full(4, jnp.nan)
        sk, ml = (
            Estimates(jnp.append(fit.values, missing), jnp.append(fit.stderr, missing), fit.converged)
            for fit in fit_response(frf, BAND)
        )
        return sk, ml

    return jax.vmap(one)(lanes["fast_u"], lanes["fast_x"])


def slowly(theta: Float[Array, " 7"], lanes: Lanes) -> tuple[Estimates, Float[Array, "lanes 7"]]:
    """Least squares on the break-aways in `lanes` of the drive `theta`, and the logarithms found, `(lanes, 7)`."""
    return _read(fit_positions(lanes["start"], (_slow(theta, lanes),), APPROACH + (0.0,) * BREAKAWAY_STEPS))


def jointly(theta: Float[Array, " 7"], lanes: Lanes) -> tuple[Estimates, Float[Array, "lanes 7"]]:
    """Least squares on both experiments in `lanes`, started at their `found`; as `slowly`, of the drive `theta`."""
    return _read(fit_positions(lanes["found"], (_slow(theta, lanes), _fast(lanes)), (0.0,) * JOINT_STEPS))


def reported(theta: Float[Array, " 7"]) -> Float[Array, " 7"]:
    """J, sigma0, sigma1 + sigma2, sigma2, Fc, Fs, vs of the logarithms `theta`."""
    return jnp.exp(theta).at[2].add(jnp.exp(theta[3]))


@jax.jit
def _read(fit: LeastSquaresFits) -> tuple[Estimates, Float[Array, "lanes 7"]]:
    def one(
        theta: Float[Array, " 7"], covariance: Float[Array, "7 7"]
    ) -> tuple[Float[Array, " 7"], Float[Array, " 7"]]:
        spread = jax.jacfwd(reported)(theta)
        return reported(theta), jnp.sqrt(jnp.diagonal(spread @ covariance @ spread.T))

    return Estimates(*jax.vmap(one)(fit.theta, fit.covariance), fit.converged), fit.theta


def bounds(theta: Float[Array, " 7"], lanes: Lanes) -> Float[np.ndarray, "3 7"]:
    """Cramer-Rao bounds of the variances at unit noise, mean over the inputs in `lanes`, for the drive `theta`.

    From the noise record with the levels of friction and sigma2 known, from the break-away alone, and from both.
    """
    count = lanes["start"].shape[0]
    at, unit = jnp.tile(theta, (count, 1)), jnp.ones(count)
    slow, fast = (
        equations(at, records, unit, jnp.zeros(()))[1] for records in (_slow(theta, lanes), _fast(lanes))
    )
    spread = jax.jacfwd(reported)(theta)

    def one(slow: Float[Array, "7 7"], fast: Float[Array, "7 7"]) -> Float[Array, "3 7"]:
        known = jnp.zeros((7, 7)).at[:3, :3].set(inverse(fast[:3, :3]))
        return jnp.stack(
            [jnp.diagonal(spread @ part @ spread.T) for part in (known, inverse(slow), inverse(slow + fast))]
        )

    return np.asarray(jnp.mean(jax.vmap(one)(slow, fast), axis=0))


def part_width(count: int, width: int) -> int:
    """Width of equal parts of `count` lanes, at most `width`: equal, so that one compiled program serves them all."""
    return -(-count // -(-count // width))


def in_parts(
    function: Callable[[Any], Any],
    lanes: Any,
    width: int,
    executor: Executor | None,
    report: Callable[[float], None],
) -> tuple[Any, float]:
    """Run a batched `function` on all `lanes`, `width` at a time, on the threads of `executor` if there is one.

    `report` is called with the finished part. Returns the outputs as numpy arrays, and the seconds that it took
    without compilation.
    """
    count = jax.tree.leaves(lanes)[0].shape[0]
    width = part_width(count, width)
    parts = -(-count // width)
    # The last part is filled up with lanes that are dropped.
    places = [np.minimum(np.arange(i * width, (i + 1) * width), count - 1) for i in range(parts)]

    def part(place: Int[np.ndarray, " width"]) -> Any:
        return jax.tree.map(np.asarray, function(jax.tree.map(lambda leaf: leaf[place], lanes)))

    clock, started = CompileClock(), perf_counter()
    found = []
    # The first part compiles what the others share, so it goes ahead of them.
    first = part(places[0])
    rest = map(part, places[1:]) if executor is None else executor.map(part, places[1:])
    for one in itertools.chain([first], rest):
        found.append(one)
        report(len(found) / parts)
    seconds = perf_counter() - started - clock.seconds
    return jax.tree.map(lambda *pieces: np.concatenate(pieces)[:count], *found), seconds
