"""Fits of data sets of one shape, side by side on one device: the two descents of `fit`, and what is kept of each."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.descent.refine import ManyFits, at_start, refine
from frictionjax.estimation.descent.round import FitState
from frictionjax.estimation.descent.settle import robust_costs, settle
from frictionjax.estimation.evidence import Noise
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import cluster_curvatures, spread_out
from frictionjax.estimation.parameters import at_an_end
from frictionjax.estimation.uncertainty import clustered_covariance


class Sets(eqx.Module):
    """What differs from data set to data set; shapes `(d, ...)`.

    **Attributes:** `u`, `x`, `noise`, `x0`, `v0` as in `Batch`; `vector` and `other`: two starts.
    """

    u: Float[Numbers, "d r n"]
    x: Float[Numbers, "d r n"]
    noise: Float[Numbers, "d r"]
    x0: Float[Numbers, "d r"]
    v0: Float[Numbers, "d r"]
    vector: Float[Numbers, "d q"]
    other: Float[Numbers, "d q"]


class Found(eqx.Module):
    """Where the fits of `d` data sets ended.

    **Attributes:** `vector`: free coordinates; `values` of the p parameters, their `slopes` by the vector; `hessian`
    of the cost and `covariance` of the vector; `at_end`: which values are at the end of their range; `noise`; `cost`,
    `moved`, `converged`: as in `Replicas`.
    """

    vector: Float[np.ndarray, "d q"]
    values: Float[np.ndarray, "d p"]
    slopes: Float[np.ndarray, "d p q"]
    hessian: Float[np.ndarray, "d q q"]
    covariance: Float[np.ndarray, "d q q"]
    at_end: Bool[np.ndarray, "d p"]
    noise: Noise
    cost: Float[np.ndarray, " d"]
    moved: Float[np.ndarray, " d"]
    converged: Bool[np.ndarray, " d"]


@eqx.filter_jit
def _posteriors(posterior: Posterior, sets: Sets, vectors: Float[Numbers, "d q"]) -> Posterior:
    """The `posterior` with the numbers of each data set, about its own of `vectors`; leaves of shape `(d, ...)`."""

    def one(own: Sets, start: Float[Numbers, " q"]) -> Posterior:
        batch = eqx.tree_at(
            lambda b: (b.u, b.x, b.noise, b.x0, b.v0),
            posterior.batch,
            (own.u, own.x, own.noise, own.x0, own.v0),
        )
        return eqx.tree_at(lambda p: (p.evidence[0].batch, p.start), posterior, (batch, start))

    return jax.vmap(one)(sets, jnp.asarray(vectors))


@eqx.filter_jit
def _within(posteriors: Posterior, vectors: Float[Numbers, "d q"]) -> tuple[Posterior, Float[Numbers, "d q"]]:
    """The `vectors` inside their ranges, and the `posteriors` about them."""
    inside = jax.vmap(lambda posterior, vector: posterior.within(vector))(posteriors, vectors)
    return eqx.tree_at(lambda p: p.start, posteriors, inside), inside


def fitted(posterior: Posterior, sets: Sets, *, substeps: int, first_descent: bool) -> Found:
    """Fit the model of `posterior` to each of `sets`, all on the device that they are on.

    **Arguments:**

    - `posterior`: `Observed` evidence of the shape of all sets.
    - `sets`: d of them.
    - `substeps`: integration steps per sample.
    - `first_descent`: go down a robust cost first, from the better of the two starts.

    **Returns:**

    What was `Found`, as numpy arrays.
    """
    vectors = jnp.asarray(sets.vector)
    posteriors = _posteriors(posterior, sets, vectors)
    if first_descent:
        other = jnp.asarray(sets.other)
        costs = [robust_costs(posteriors, start, each=True) for start in (vectors, other)]
        vectors = jnp.where(jnp.asarray(costs[0] <= costs[1])[:, None], vectors, other)
        vectors, _ = settle(eqx.tree_at(lambda p: p.start, posteriors, vectors), vectors, each=True)
        posteriors, vectors = _within(posteriors, vectors)
    known = np.zeros(sets.x.shape[1], dtype=bool)
    refined = refine(ManyFits(known, substeps), at_start(posteriors, vectors), near=not first_descent)
    near = jax.tree.map(np.asarray, _near(refined.state))
    place = posterior.places[0]
    covariance = [
        clustered_covariance(matrix, [own], [spread_out(parts, place)], [place.rows])
        for matrix, own, parts in zip(near.hessian, near.clusters, near.curvatures, strict=True)
    ]
    noise, progress = (jax.tree.map(np.array, own) for own in (refined.state.noise, refined.progress))
    return Found(
        np.array(refined.state.vector),
        near.values,
        near.slopes,
        near.hessian,
        np.stack(covariance),
        near.at_end,
        noise,
        progress.least,
        progress.moved,
        progress.converged,
    )


class _Near(NamedTuple):
    """At the minimum of each of `d` fits: `values` of the parameters, their `slopes` by the vector and which are at the
    end of their range, `at_end`; `hessian` of the cost, and gradients, `clusters`, and `curvatures` of its clusters."""

    values: Float[Numbers, "*d p"]
    slopes: Float[Numbers, "*d p q"]
    at_end: Bool[Numbers, "*d p"]
    hessian: Float[Numbers, "*d q q"]
    clusters: Float[Numbers, "*d c q"]
    curvatures: Float[Numbers, "*d r m k k"]


@eqx.filter_jit
def _near(states: FitState) -> _Near:
    """What is near each of `states`."""

    def one(state: FitState) -> _Near:
        there, vector, count = state.posterior, state.vector, state.posterior.parameters
        evaluations = there.evaluate(vector)
        near = there.assembled(evaluations, vector)
        parts = (there.loss, there.weights[0], there.places[0], there.fitted[0])
        bent = cluster_curvatures(evaluations[0], *parts)

        def values(point: Float[Numbers, " q"]) -> Float[Numbers, " p"]:
            return there.model.values_of(point[:count])[:count]

        own = values(vector)
        at_end = at_an_end(there.layout, vector[:count], there.start[:count], own)
        return _Near(own, jax.jacfwd(values)(vector), at_end, near.hessian, near.clusters[0], bent)

    return jax.vmap(one)(states)
