"""From any start into the right valley: robust Levenberg-Marquardt on forgiving evidence, many starts side by side."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.descent.levenberg_marquardt import equal_curvature, levenberg_marquardt
from frictionjax.estimation.objective.loss import Cauchy
from frictionjax.estimation.objective.posterior import Posterior

_QUANTILES = (0.95, 0.8, 0.5)  # of the block powers: knees of the loss, in turn, before it is at the noise
_NEAR = 1.2  # a knee below this many noise powers is as good as at the noise
_STEPS = 4  # of Levenberg-Marquardt in a round; the first only looks around
_ENOUGH = 0.05  # a round at the noise that takes less than this part off the cost is the last


@eqx.filter_jit
def _powers(posterior: Posterior, vectors: Float[Array, "k q"]) -> Float[Array, "k b"]:
    """Mean square of each block of all evidence, in noise levels, for each of `vectors`."""

    def one(vector):
        found = []
        for index, evidence in enumerate(posterior.evidence):
            e = posterior.errors(vector, index)
            found.append(jnp.sum(e * e, axis=1) / jnp.maximum(evidence.count, 1.0))
        return jnp.concatenate(found)

    return jax.vmap(one)(vectors)


@eqx.filter_jit
def _units(posterior, vectors):
    return jax.vmap(lambda vector: equal_curvature(posterior, vector))(vectors)


@eqx.filter_jit
def _round(posterior, vectors, units, knees):
    def one(vector, unit, knee):
        there = eqx.tree_at(lambda p: p.loss, posterior, Cauchy(knee))
        return levenberg_marquardt(there, vector, unit, _STEPS).vector

    return jax.vmap(one)(vectors, units, knees)


def robust_costs(posterior: Posterior, vectors: Float[Array, "k q"]) -> Float[np.ndarray, " k"]:
    """Mean of log((1 + block power)/2)/2 over the scored samples of the `posterior` at each of `vectors`, shape `(k,)`:
    0 at the noise; infinite where a run is not finite."""
    return _costs(np.asarray(_powers(posterior, vectors)), posterior)


def _costs(powers, posterior):
    count = np.concatenate([np.asarray(evidence.count) for evidence in posterior.evidence])
    total = 0.5 * np.log((1.0 + powers) / 2.0) @ count / count.sum()
    return np.where(np.isfinite(total), total, np.inf)


def settle(
    posterior: Posterior, vectors: Float[Array, "k q"], *, rounds: int = 6
) -> tuple[Float[Array, "k q"], Float[np.ndarray, " k"]]:
    """Bring down the robust cost of `posterior` from each of `vectors`, shape `(k, q)`, all side by side.

    The knee of the loss comes down from the upper quantiles of the block powers to the noise: with the knee at the
    noise from the start, a regime that misfits would be ignored.

    **Arguments:**

    - `posterior`: forgiving evidence (`Observed`); its own loss is not used.
    - `vectors`: starts.
    - `rounds`: at most this many with the knee at the noise.

    **Returns:**

    The vectors, shape `(k, q)`, and their robust costs (`robust_costs`), shape `(k,)`.
    """
    scored = np.concatenate([np.asarray(evidence.count) for evidence in posterior.evidence]) > 0
    powers = np.asarray(_powers(posterior, vectors))
    best, least = vectors, _costs(powers, posterior)
    units = None
    for knee_at in (*_QUANTILES, *(None,) * rounds):
        if knee_at is None:
            knees = np.ones(len(least))
        else:
            finite = np.where(np.isfinite(powers), powers, 1e12)
            knees = np.maximum(np.quantile(finite[:, scored], knee_at, axis=1), 1.0)
            if np.all(knees < _NEAR):
                continue
        if units is None:
            units = _units(posterior, vectors)
        vectors = _round(posterior, vectors, units, jnp.asarray(knees))
        powers = np.asarray(_powers(posterior, vectors))
        costs = _costs(powers, posterior)
        gained = least - costs
        better = gained > 0.0
        best = jnp.where(jnp.asarray(better)[:, None], vectors, best)
        least = np.where(better, costs, least)
        if knee_at is None:
            vectors = best
            if np.all(gained < np.maximum(_ENOUGH * least, 1e-4)):
                break
    return best, least
