"""The first descent of a fit, from any start: robust Levenberg-Marquardt on a fixed-gain observer, side by side."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.descent.levenberg_marquardt import equal_curvature, levenberg_marquardt
from frictionjax.estimation.objective.loss import GRADUATION, Cauchy
from frictionjax.estimation.objective.misfit import block_misfits
from frictionjax.estimation.objective.posterior import Posterior

_STEPS = 4  # of Levenberg-Marquardt at one scale of the loss; the first only evaluates the start
_ROUNDS = 6  # with the scale at the noise, at most
_ENOUGH = 0.05  # a round at the noise that takes less than this part off the cost is the last
_LEAST_GAIN = 1e-4  # or less than this


def _powers(posterior: Posterior, vectors: Float[Numbers, "k q"], each: bool) -> Float[Numbers, "k b"]:
    """Mean square of each block of all evidence, in noise levels, for each of `vectors`."""
    if each:
        return _powers_of_each(posterior, jnp.asarray(vectors))
    found = [[one.power.ravel() for one in posterior.evaluated(vector)] for vector in vectors]
    return np.stack([np.concatenate(own) for own in found])


@eqx.filter_jit
def _powers_of_each(posteriors: Posterior, vectors: Float[Numbers, "k q"]) -> Float[Numbers, "k b"]:
    def one(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[Numbers, " b"]:
        found = []
        for index, evidence in enumerate(posterior.evidence):
            e = posterior.errors(vector, index)
            found.append(jnp.sum(e * e, axis=1) / jnp.maximum(evidence.count, 1.0))
        return jnp.concatenate(found)

    return jax.vmap(one)(posteriors, vectors)


def _units(posterior: Posterior, vectors: Float[Numbers, "k q"], each: bool) -> Float[Numbers, "k q"]:
    if each:
        return _units_of_each(posterior, jnp.asarray(vectors))
    return np.stack([equal_curvature(posterior, vector) for vector in vectors])


_units_of_each = eqx.filter_jit(jax.vmap(equal_curvature))


def _round(
    posterior: Posterior,
    vectors: Float[Numbers, "k q"],
    units: Float[Numbers, "k q"],
    scales: Float[np.ndarray, " k"],
    each: bool,
) -> Float[Numbers, "k q"]:
    """A few steps down the robust cost of each, with these `scales` of the loss."""
    if each:
        return _round_of_each(posterior, jnp.asarray(vectors), units, jnp.asarray(scales))
    rows = zip(vectors, units, scales, strict=True)
    return np.stack([_steps(posterior, vector, unit, scale) for vector, unit, scale in rows])


def _steps(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    unit: Float[Numbers, " q"],
    scale: Float[Numbers, ""],
) -> Float[Numbers, " q"]:
    there = eqx.tree_at(lambda p: p.loss, posterior, Cauchy(scale))
    return levenberg_marquardt(there, vector, unit, _STEPS).vector


_round_of_each = eqx.filter_jit(jax.vmap(_steps))


def robust_costs(
    posterior: Posterior, vectors: Float[Numbers, "k q"], *, each: bool = False
) -> Float[np.ndarray, " k"]:
    """Robust misfit per scored sample of all evidence (`block_misfits`) at each of `vectors`: 0 at the noise; infinite
    where a run is not finite.

    **Arguments:**

    - `posterior`: of all `vectors`; or, with `each`, one for each of them, leaves of shape `(k, ...)`.
    - `vectors`: shape `(k, q)`.
    """
    return _costs(np.asarray(_powers(posterior, vectors, each)), np.asarray(_counts(posterior, each)))


def _counts(posterior: Posterior, each: bool) -> Float[np.ndarray, " b"]:
    """Scored numbers in each block of all evidence; posteriors side by side score the same ones."""
    one = jax.tree.map(lambda leaf: np.asarray(leaf)[0], posterior) if each else posterior
    return np.concatenate([np.asarray(evidence.count) for evidence in one.evidence])


def _costs(powers: Float[np.ndarray, "k b"], count: Float[np.ndarray, " b"]) -> Float[np.ndarray, " k"]:
    total = block_misfits(powers, count).sum(axis=-1) / count.sum()
    return np.where(np.isfinite(total), total, np.inf)


def _scales(
    powers: Float[np.ndarray, "k b"], scored: Bool[np.ndarray, " b"], quantile: float
) -> Float[np.ndarray, " k"]:
    """That quantile of the powers of the scored blocks of each, at least that of the noise."""
    finite = np.where(np.isfinite(powers), powers, 1e12)
    return np.maximum(np.quantile(finite[:, scored], quantile, axis=1), 1.0)


def settle(
    posterior: Posterior, vectors: Float[Numbers, "k q"], *, each: bool = False
) -> tuple[Float[np.ndarray, "k q"], Float[np.ndarray, " k"]]:
    """Bring down the robust cost of `posterior` from each of `vectors`, all side by side.

    The scale of the loss comes down from the upper quantiles of the block powers to the noise: with the scale at the
    noise from the start, a regime that the model misses would be ignored.

    **Arguments:**

    - `posterior`: of `Observed` positions; its own loss is not used. One for all `vectors`; or, with `each`,
        one for each of them, leaves of shape `(k, ...)`.
    - `vectors`: starts, shape `(k, q)`.

    **Returns:**

    The vectors, shape `(k, q)`, and their robust costs (`robust_costs`), shape `(k,)`.
    """
    count = np.asarray(_counts(posterior, each))
    powers = np.asarray(_powers(posterior, vectors, each))
    best, least = vectors, _costs(powers, count)
    units = None
    for quantile in (*GRADUATION, *(None,) * _ROUNDS):
        if quantile is None:
            scales = np.ones(len(least))
        else:
            scales = _scales(powers, count > 0, quantile)
            if np.all(scales <= 1.0):
                continue
        if units is None:
            units = _units(posterior, vectors, each)
        vectors = _round(posterior, vectors, units, scales, each)
        powers = np.asarray(_powers(posterior, vectors, each))
        costs = _costs(powers, count)
        gained = least - costs
        better = gained > 0.0
        best = np.where(better[:, None], np.asarray(vectors), np.asarray(best))
        least = np.where(better, costs, least)
        if quantile is None:
            vectors = best
            if np.all(gained < np.maximum(_ENOUGH * least, _LEAST_GAIN)):
                break
    return best, least
