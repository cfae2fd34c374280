"""The way of `fit` for a few data sets of one shape at once: its rounds, each one compiled program for all."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.descent.levenberg_marquardt import STRIDE, equal_curvature, levenberg_marquardt
from frictionjax.estimation.descent.refine import (
    ALIKE,
    AT_FIRST,
    CLOSE,
    LIKELY,
    LONG,
    NEXT,
    ROUNDS,
    SHORT,
    STEPS,
    STILL,
)
from frictionjax.estimation.evidence import Noise, Observed, filtered, scored_from_the_start
from frictionjax.estimation.objective.loss import Cauchy
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import cluster_curvatures, spread_out
from frictionjax.estimation.parameters import part_of
from frictionjax.estimation.uncertainty import clustered_covariance

_QUANTILE = 0.8  # of the block powers: the knee of the robust loss, before it is at the noise
_AT_THE_NOISE = 2  # rounds with the knee at the noise


class Sets(eqx.Module):
    """What differs from data set to data set; shapes `(d, ...)`.

    **Attributes:** `u`, `x`, `noise`, `x0`, `v0` as in `Batch`; `vector` and `other`: two starts.
    """

    u: Float[Array | np.ndarray, "d r n"]
    x: Float[Array | np.ndarray, "d r n"]
    noise: Float[Array | np.ndarray, "d r"]
    x0: Float[Array | np.ndarray, "d r"]
    v0: Float[Array | np.ndarray, "d r"]
    vector: Float[Array | np.ndarray, "d q"]
    other: Float[Array | np.ndarray, "d q"]


class Found(eqx.Module):
    """Where the fits of `d` data sets ended.

    **Attributes:** `vector`: free coordinates; `values` of the p parameters, their `slopes` by the vector; `hessian`
    of the cost and `covariance` of the vector; `noise`; `cost`; `moved`: as in `Replicas`.
    """

    vector: Float[np.ndarray, "d q"]
    values: Float[np.ndarray, "d p"]
    slopes: Float[np.ndarray, "d p q"]
    hessian: Float[np.ndarray, "d q q"]
    covariance: Float[np.ndarray, "d q q"]
    noise: Noise
    cost: Float[np.ndarray, " d"]
    moved: Float[np.ndarray, " d"]


def _batch_of(posterior: Posterior) -> Batch:
    """The recordings of `posterior`, its only evidence."""
    (seen,) = posterior.evidence
    if not isinstance(seen, Observed):
        raise TypeError("Many fits at once are for positions.")
    return seen.batch


def _with(posterior: Posterior, one: Sets, start) -> Posterior:
    """The `posterior` with the numbers of one data set."""
    batch = eqx.tree_at(
        lambda b: (b.u, b.x, b.noise, b.x0, b.v0),
        _batch_of(posterior),
        (one.u, one.x, one.noise, one.x0, one.v0),
    )
    return eqx.tree_at(lambda p: (p.evidence[0].batch, p.start), posterior, (batch, start))


def _powers(posterior: Posterior, vector):
    """Mean square of each block in noise levels; large where a run is not finite."""
    e = posterior.errors(vector, 0)
    power = jnp.sum(e * e, axis=1) / jnp.maximum(posterior.evidence[0].count, 1.0)
    return jnp.where(jnp.isfinite(power), power, 1e12)


@eqx.filter_jit
def _begin(posterior: Posterior, sets: Sets):
    """Of two starts the one with the lower robust cost; the units there, and the knee of the loss."""

    def one(own: Sets):
        there = _with(posterior, own, own.vector)
        count = there.evidence[0].count
        powers = [_powers(there, start) for start in (own.vector, own.other)]
        first, second = (jnp.sum(count * jnp.log1p(power)) for power in powers)
        vector = jnp.where(first <= second, own.vector, own.other)
        power = jnp.where(count > 0, jnp.where(first <= second, *powers), jnp.nan)
        knee = jnp.maximum(jnp.nanquantile(power, _QUANTILE), 1.0)
        return vector, equal_curvature(there, vector), knee

    return jax.vmap(one)(sets)


@eqx.filter_jit
def _settled(posterior: Posterior, sets: Sets, vectors, units, knees):
    """A round down the robust cost."""

    def one(own: Sets, vector, unit, knee):
        there = eqx.tree_at(lambda p: p.loss, _with(posterior, own, own.vector), Cauchy(knee))
        return there.within(levenberg_marquardt(there, vector, unit, STEPS).vector)

    return jax.vmap(one)(sets, vectors, units, knees)


@eqx.filter_jit
def _levels(posterior: Posterior, sets: Sets, starts, vectors):
    """Coulomb friction over the position noise of each recording, shape `(d, r)`."""

    def one(own: Sets, start, vector):
        return _with(posterior, own, start).drive_of(vector).friction.Fc / own.noise

    return jax.vmap(one)(sets, starts, vectors)


def _filtered(posterior: Posterior, own: Sets, start, vector, ratio, substeps: int):
    there = _with(posterior, own, start)
    batch = scored_from_the_start(_batch_of(there))
    known = jnp.zeros(batch.x.shape[0], dtype=bool)
    drive, z0 = there.drive_of(vector), there.deflections_of(vector, 0)
    positions, noise = filtered(drive, z0, batch, ratio, known, substeps)
    return eqx.tree_at(lambda p: p.evidence, there, (positions,)), noise


@eqx.filter_jit
def _units(posterior: Posterior, sets: Sets, starts, vectors, ratios, substeps: int):
    def one(own: Sets, start, vector, ratio):
        there, _ = _filtered(posterior, own, start, vector, ratio, substeps)
        return LONG * equal_curvature(there, vector)

    return jax.vmap(one)(sets, starts, vectors, ratios)


@eqx.filter_jit
def _round(posterior: Posterior, sets: Sets, starts, vectors, units, ratios, substeps: int):
    """Noise, then parameters: the vectors, their units, the noise, how far they moved, and their costs."""

    def one(own: Sets, start, vector, unit, ratio):
        there, noise = _filtered(posterior, own, start, vector, ratio, substeps)
        end = levenberg_marquardt(there, vector, unit, STEPS, tolerance=CLOSE)
        far = jnp.max(jnp.abs(end.vector - vector) / end.unit) * STRIDE
        return there.within(end.vector), LONG * end.unit, noise, far, end.cost + there.log_deviation

    return jax.vmap(one)(sets, starts, vectors, units, ratios)


@eqx.filter_jit
def _told(posterior: Posterior, sets: Sets, starts, vectors, ratios, substeps: int):
    """All that is kept of each data set, but for how far it moved."""

    def one(own: Sets, start, vector, ratio):
        there, noise = _filtered(posterior, own, start, vector, ratio, substeps)
        evaluation = there.evaluate(vector)
        near = there.quadratic(vector)
        parts = (there.loss, there.weights[0], there.places[0], there.fitted[0])
        bent = cluster_curvatures(evaluation[0], *parts)

        def values(point):
            drive = there.drive_of(point)
            return jnp.stack([part_of(drive, free.path) for free in there.constraints.layout])

        cost = near.cost + there.log_deviation
        return values(vector), jax.jacfwd(values)(vector), near.hessian, (near.clusters[0], bent), noise, cost

    return jax.vmap(one)(sets, starts, vectors, ratios)


def follow(posterior: Posterior, sets: Sets, *, substeps: int, settle: bool) -> Found:
    """Fit the model of `posterior` to each of `sets`, all on the device that they are on.

    **Arguments:**

    - `posterior`: `Observed` evidence of the shape of all sets.
    - `sets`: d of them.
    - `substeps`: integration steps per sample.
    - `settle`: go down a robust cost first, from the better of the two starts.

    **Returns:**

    What was `Found`, as numpy arrays.
    """
    vectors = jnp.asarray(sets.vector)
    if settle:
        vectors, units, knees = _begin(posterior, sets)
        for round_knees in (knees, *(jnp.ones_like(knees),) * _AT_THE_NOISE):
            vectors = _settled(posterior, sets, vectors, units, round_knees)
    starts, units, about = vectors, None, _levels(posterior, sets, vectors, vectors)
    last = moved = np.full(vectors.shape[0], np.inf)
    for parts in ((AT_FIRST,) if settle else ()) + (LIKELY, *(NEXT,) * ROUNDS):
        if parts is LIKELY:
            about = _levels(posterior, sets, starts, vectors)
        ratios = about[:, :, None] * jnp.asarray(parts)[None, None]
        if units is None:
            units = _units(posterior, sets, starts, vectors, ratios, substeps)
        vectors, units, noise, far, cost = _round(posterior, sets, starts, vectors, units, ratios, substeps)
        moved, gained, last = np.asarray(far), last - np.asarray(cost), np.asarray(cost)
        same = np.all(np.abs(np.log(np.asarray(noise.best) / np.asarray(about))) < ALIKE, axis=1)
        about = noise.best
        # A fit that was lost stays lost.
        done = (moved < SHORT) & (same | (np.abs(gained) < STILL)) | ~np.isfinite(moved)
        if parts is NEXT and np.all(done):
            break
    ratios = about[:, :, None] * jnp.asarray(NEXT)[None, None]
    told = _told(posterior, sets, starts, vectors, ratios, substeps)
    values, slopes, hessian, (clusters, bent), noise, cost = jax.tree.map(np.asarray, told)
    place = posterior.places[0]
    covariance = np.stack(
        [
            clustered_covariance(matrix, [own], [spread_out(parts, place)], [place.rows])
            for matrix, own, parts in zip(hessian, clusters, bent, strict=True)
        ]
    )
    return Found(np.asarray(vectors), values, slopes, hessian, covariance, noise, cost, moved)
