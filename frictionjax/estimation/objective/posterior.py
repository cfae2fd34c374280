"""The objective of a fit: the loss of all evidence, the weak prior, and the priors that a user gives.

One objective for `fit` and `diagnose`. Many fits side by side evaluate it inside their compiled descent. A single fit
and a diagnosis evaluate it step by step: simulations and their derivatives are compiled, one program a structure,
whatever the number and the length of the recordings (`data/pieces.py`); NumPy makes the products.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers, known, numpy_or_jax
from frictionjax.estimation.constraints import Constraints, belief_residuals
from frictionjax.estimation.data.batch import AbstractBatch, rows_of
from frictionjax.estimation.data.pieces import put_together
from frictionjax.estimation.evidence import AbstractEvidence, AbstractRecordings, Observed, Positions
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.loss import AbstractLoss
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.model import ParametricModel, side_by_side, with_slopes
from frictionjax.estimation.objective.quadratic import (
    AbstractObjective,
    Evaluation,
    EvidenceCoordinates,
    Quadratic,
    cluster_curvatures,
    quadratic_of,
    spread_out,
)
from frictionjax.estimation.parameters import INSIDE, Free, pack, touching, unpack
from frictionjax.physics import Drive

_SQUARED = 1e150  # the square of more is no number
LANES = 6
"""Vectors that are simulated side by side. One number everywhere, so that each layout is compiled once."""


class _Parts(NamedTuple):
    """What the cost of all evidence is made of, evidence by evidence: as in `quadratic_of`."""

    evaluations: tuple[Evaluation, ...]
    counts: tuple[Float[Numbers, "..."], ...]
    weights: tuple[Float[Numbers, "..."], ...]
    loss: AbstractLoss
    fitted: tuple[Float[Numbers, "..."], ...]


class _Prior(NamedTuple):
    """A free vector, the centre of the weak prior and its inverse standard deviations, shape `(q,)` each."""

    vector: Float[Numbers, " q"]
    start: Float[Numbers, " q"]
    stiffness: Float[Numbers, " q"]


class Posterior(AbstractObjective):
    """Minus the logarithm of the posterior density of the free vector, but for a constant.

    The vector has the p free parameters, then the starting deflection (over Fs/sigma0) of each recording, evidence by
    evidence; q in all. Held-out recordings are predicted in the same run and determine only their own deflections.

    **Attributes:** `constraints`, `drive` (structure and fixed parameters), `start` (centre of the admissible range and
    of the weak prior), `prior` (its inverse standard deviations), shape `(q,)`, `evidence`, `weights` (of each
    evidence's cost, shape `(b,)` each: one for every block), `loss`, `fitted` (for each evidence 1 for fitted
    rows, 0 for held-out ones, shape `(r,)`), `ceilings` (for each evidence the largest derivative that is credible in
    each row, shape `(r,)`; None where all count).
    """

    constraints: Constraints
    drive: Drive
    start: Float[Numbers, " q"]
    prior: Float[Numbers, " q"]
    evidence: tuple[AbstractEvidence, ...]
    weights: tuple[Float[Numbers, "..."], ...]
    loss: AbstractLoss
    fitted: tuple[Float[Numbers, "..."], ...]
    ceilings: tuple[Float[Numbers, "..."] | None, ...]

    @property
    def layout(self) -> tuple[Free, ...]:
        """The free parameters."""
        return self.constraints.layout

    @property
    def parameters(self) -> int:
        """Number of free parameters, p."""
        return len(self.layout)

    @property
    def places(self) -> tuple[EvidenceCoordinates, ...]:
        """Where the coordinates of each evidence stand in the free vector."""
        found, first = [], self.parameters
        size = first + sum(one.rows for one in self.evidence)
        for one in self.evidence:
            found.append(EvidenceCoordinates(self.parameters, first, one.rows, size))
            first += one.rows
        return tuple(found)

    @property
    def has_positions(self) -> bool:
        """Whether any recording is force-driven."""
        return any(isinstance(one, Observed | Positions) for one in self.evidence)

    @property
    def log_deviation(self) -> Float[Numbers, ""]:
        """What the noise adds to the cost: sum of the logarithms of all standard deviations, weighted as the errors."""
        xp, weights = known(self.weights)
        return xp.asarray(
            sum(weight @ one.log_deviation for one, weight in zip(self.evidence, weights[0], strict=True))
        )

    @property
    def model(self) -> ParametricModel:
        """What turns its parameters into a `Drive`."""
        _, (start,) = known(self.start)
        return ParametricModel(self.constraints, self.drive, start[: self.parameters])

    def drive_of(self, vector: Float[Numbers, " q"]) -> Drive:
        """The `Drive` of a free vector, shape `(q,)`."""
        _, (vector,) = known(vector)
        return self.model.drive_of(vector[: self.parameters])

    def deflections_of(self, vector: Float[Numbers, " q"], index: int) -> Float[Numbers, " rows"]:
        """Starting deflections, over Fs/sigma0, of the recordings of evidence number `index`."""
        _, (vector,) = known(vector)
        place = self.places[index]
        return vector[place.first : place.first + place.rows]

    def within(self, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
        """`vector`, shape `(q,)`, with coordinates beyond an end of their range at that end: further out the cost is
        constant, and they would never come back."""
        xp, (vector, start) = known(vector, self.start)
        count = self.parameters
        free = unpack(self.layout, self.drive, vector[:count], start[:count])
        return xp.concatenate([pack(self.layout, free), xp.clip(vector[count:], -1.0, 1.0)])

    def reaching(self, vector: Float[Numbers, " q"]) -> "Posterior":
        """The same, with the range of a coordinate that is at its end at `vector`, shape `(q,)`, centred there: a
        descent from a bad start may have further to go. Works inside transformations."""
        xp, (vector, start) = known(vector, self.start)
        count = self.parameters
        ends = touching(self.layout, vector[:count], start[:count], margin=2.0 * INSIDE)
        ends = xp.pad(xp.asarray(ends), (0, vector.shape[0] - count))
        return eqx.tree_at(lambda p: p.start, self, xp.where(ends, vector, start))

    def errors(self, vector: Float[Numbers, " q"], index: int) -> Float[Numbers, "b n"]:
        """Errors over their standard deviations of evidence number `index`, shape `(b, n)`, at `vector`."""
        return self.evidence[index].errors(self.drive_of(vector), self.deflections_of(vector, index))

    def evaluate(self, vector: Float[Numbers, " q"]) -> tuple[Evaluation, ...]:
        """The errors of each evidence at `vector`, and their forward-mode derivatives; inside compiled functions."""
        found = []
        for index, (one, place) in enumerate(zip(self.evidence, self.places, strict=True)):
            many, rows = place.parameters, max(place.rows, 1)
            basis = jnp.eye(many + (place.rows > 0), place.size)
            if place.rows:
                # It moves its own recording only, so one column serves all of them.
                basis = basis.at[many].set(0.0).at[many, place.first : place.first + place.rows].set(1.0)
            e, columns = jax.vmap(
                lambda way, index=index: jax.jvp(lambda q: self.errors(q, index), (vector,), (way,)),
                out_axes=(None, 0),
            )(basis)
            power = jnp.sum(e * e, axis=1) / jnp.maximum(one.count, 1.0)
            columns = columns.reshape(columns.shape[0], rows, -1)
            sound = self.sound_blocks(index, columns)
            found.append(Evaluation(e.reshape(rows, -1), power.reshape(rows, -1), columns, sound))
        return tuple(found)

    def sound_blocks(self, index: int, columns: Float[Numbers, "k r n"]) -> Bool[Numbers, "r b"]:
        """The blocks of evidence number `index` in which derivatives, the `columns`, are credible.

        A bristle that yields between two samples, time and again, makes the motion chaotic: its derivatives grow
        without bound and do not predict the effect of a finite step, and one such block would outvote all others. No
        parameter can do more than replace the whole motion by another: beyond the ceiling a block is not sound. A
        starting deflection can: its range is far more than a machine in stick moves.
        """
        xp, (ceiling, columns) = known(self.ceilings[index], columns)
        rows = columns.shape[1]
        blocks = self.evidence[index].count.shape[0] // rows
        if ceiling is None:
            return xp.ones((rows, blocks), dtype=bool)
        # Each by itself: a maximum may skip what is not a number.
        bounded = xp.all(xp.abs(columns[: self.parameters]) <= ceiling[None, :, None], axis=0)
        bounded = bounded & (xp.abs(columns[-1]) < _SQUARED)
        return xp.all(bounded.reshape(rows, blocks, -1), axis=-1)

    def quadratic(self, vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost near `vector`, shape `(q,)`."""
        parts = self._parts(self.evaluate(vector))
        return _total(parts, self.places, self._prior(vector)) + self._beliefs(vector)

    # Step by step, as in a single fit and in a diagnosis.

    def evaluated(self, vector: Float[Numbers, " q"]) -> tuple[Evaluation, ...]:
        """`evaluate` piece by piece: one program for each structure."""
        _, (vector,) = known(vector)
        found = []
        for index, one in enumerate(self.evidence):
            e, columns = self._with_slopes(one, vector[: self.parameters], self.deflections_of(vector, index))
            count = np.asarray(one.count)
            with _overflowing():
                squares = np.sum((e * e).reshape(count.size, -1), axis=1)
                power = (squares / np.maximum(count, 1.0)).reshape(e.shape[0], -1)
                found.append(Evaluation(e, power, columns, self.sound_blocks(index, columns)))
        return tuple(found)

    def _with_slopes(
        self, evidence: AbstractEvidence, parameters: Float[np.ndarray, " p"], z0: Float[np.ndarray, " rows"]
    ) -> tuple[Float[np.ndarray, "r n"], Float[np.ndarray, "k r n"]]:
        """Errors of the `evidence` and their derivatives, as in an `Evaluation`."""
        model = self.model
        if not evidence.rows:
            e, columns = with_slopes(model, evidence, parameters, z0)
            return np.asarray(e), np.asarray(columns)
        parts = [
            (piece, *with_slopes(model, own, parameters, z0[piece.lanes]))
            for piece, own in evidence.in_pieces()
        ]
        size = (evidence.rows, evidence.samples)
        e = put_together([(piece, e) for piece, e, _ in parts], *size)
        return e, put_together([(piece, columns) for piece, _, columns in parts], *size, axis=1)

    def assembled(self, evaluations: tuple[Evaluation, ...], vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost near `vector`, of what was evaluated there."""
        with _overflowing():
            total = _total(self._parts(evaluations), self.places, self._prior(vector))
        if not self.constraints.beliefs:
            return total
        own = self._beliefs(vector) if numpy_or_jax(vector) is jnp else jax.device_get(_beliefs(self, vector))
        return total + own

    def near(self, vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost near `vector`, evaluated and assembled."""
        return self.assembled(self.evaluated(vector), vector)

    def curvatures(self, evaluations: tuple[Evaluation, ...]) -> tuple[Float[np.ndarray, "_ q q"], ...]:
        """The part that each cluster has in the Gauss-Newton matrix, evidence by evidence; without the prior, which is
        in no cluster, they add up to it."""
        with _overflowing():
            return tuple(
                spread_out(np.asarray(cluster_curvatures(one, self.loss, weight, place, fitted)), place)
                for one, weight, place, fitted in zip(
                    evaluations, self.weights, self.places, self.fitted, strict=True
                )
            )

    def _parts(self, evaluations: tuple[Evaluation, ...]) -> "_Parts":
        counts = tuple(one.count for one in self.evidence)
        return _Parts(evaluations, counts, self.weights, self.loss, self.fitted)

    def _prior(self, vector: Float[Numbers, " q"]) -> "_Prior":
        return _Prior(vector, self.start, self.prior)

    def _beliefs(self, vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost of the priors that a user gives."""
        beliefs, size = self.constraints.beliefs, vector.shape[0]
        if not beliefs:
            return Quadratic(jnp.zeros(()), jnp.zeros(size), jnp.zeros((size, size)))
        residual = belief_residuals(beliefs, self.drive_of(vector))
        slope = jax.jacfwd(lambda q: belief_residuals(beliefs, self.drive_of(q)))(vector)
        return Quadratic(0.5 * residual @ residual, slope.T @ residual, slope.T @ slope)

    # Of one evidence of recordings, as in a diagnosis.

    @property
    def recordings(self) -> AbstractRecordings:
        """The only evidence of a diagnosis: recordings side by side."""
        (one,) = self.evidence
        assert isinstance(one, AbstractRecordings)
        return one

    @property
    def batch(self) -> AbstractBatch:
        """The recordings of a diagnosis."""
        return self.recordings.batch

    @property
    def sample_weight(self) -> Float[Numbers, "r n"]:
        """Weight of the block that each sample of the recordings is in."""
        batch = self.batch
        return np.repeat(np.asarray(self.weights[0]).reshape(batch.x.shape[0], -1), batch.block, axis=1)

    def at_bandwidth(self, bandwidth: float, *, pace: Float[Numbers, " r"] | None = None) -> "Posterior":
        """The same, through an observer of `bandwidth` Hz times the `pace` of each recording; None: as it is."""
        own = self.recordings.at_bandwidth(bandwidth, pace=pace)
        return eqx.tree_at(lambda p: (p.evidence, p.ceilings), self, ((own,), (own.largest_derivative,)))

    def first(self, samples: int) -> "Posterior":
        """The same of the first so many `samples` of each recording of an applied input (`Batch.first`)."""
        recordings = self.recordings
        assert isinstance(recordings, Observed)
        own = recordings.first(samples)
        weights = np.asarray(self.weights[0]).reshape(own.rows, -1)[:, : own.samples // own.batch.block]
        return eqx.tree_at(lambda p: (p.evidence, p.weights), self, ((own,), (weights.ravel(),)))

    def on_recordings_of(self, other: "Posterior") -> "Posterior":
        """The same on the recordings of the `other` one, with its weights."""
        parts = (other.evidence, other.weights, other.ceilings)
        return eqx.tree_at(lambda p: (p.evidence, p.weights, p.ceilings), self, parts)

    def of_fitted(self, vector: Float[Numbers, " q"]) -> tuple["Posterior", Float[Numbers, " q"]]:
        """The posterior of the fitted recordings alone, and its part of `vector`."""
        rows, count = np.flatnonzero(np.asarray(self.fitted[0]) > 0), self.parameters
        kept = np.concatenate([np.arange(count), count + rows])
        evidence, fitted, ceilings = rows_of((self.recordings, self.fitted[0], self.ceilings[0]), rows)
        weights = np.asarray(self.weights[0]).reshape(self.recordings.rows, -1)[rows].ravel()
        start, prior, vector = rows_of((self.start, self.prior, vector), kept)
        own = (start, prior, (evidence,), (weights,), (fitted,), (ceilings,))
        posterior = eqx.tree_at(
            lambda p: (p.start, p.prior, p.evidence, p.weights, p.fitted, p.ceilings), self, own
        )
        return posterior, vector

    def with_substeps(self, substeps: int) -> "Posterior":
        """The same, with so many integration `substeps` a sample."""
        return eqx.tree_at(lambda p: p.evidence, self, (self.recordings.with_substeps(substeps),))

    def errors_at(self, vectors: Sequence[Float[Numbers, " q"]]) -> Float[np.ndarray, "k r n"]:
        """Standardised errors for each of `vectors`, shape `(k, r, n)`, some at a time."""
        recordings, model, count, found = self.recordings, self.model, self.parameters, []
        for first in range(0, len(vectors), LANES):
            some = np.stack([np.asarray(v) for v in vectors[first : first + LANES]])
            lanes = LANES if len(some) > 1 else 1
            stack = np.concatenate([some, np.repeat(some[-1:], lanes - len(some), axis=0)])
            parts = []
            for piece, own in recordings.in_pieces():
                e = side_by_side(model, own, stack[:, :count], stack[:, count:][:, piece.lanes])
                parts.append((piece, np.asarray(e)[: len(some)]))
            found.append(put_together(parts, recordings.rows, recordings.samples, axis=1))
        return np.concatenate(found)

    def powers(self, vectors: Sequence[Float[Numbers, " q"]]) -> Float[np.ndarray, "k r b"]:
        """Block powers of the standardised errors for each of `vectors`, shape `(k, r, b)`."""
        with _overflowing():
            return block_power(self.errors_at(vectors), self.batch)

    def misfits(self, vectors: Sequence[Float[Numbers, " q"]]) -> Float[np.ndarray, " k"]:
        """Robust misfit per sample of the fitted recordings for each of `vectors`: 0 when every block is at the noise;
        infinite where a trajectory is not finite."""
        fitted = np.asarray(self.fitted[0])
        return np.array([misfit_of(power, fitted, self.batch) for power in self.powers(vectors)])


def _overflowing() -> np.errstate:
    """Where a run may overflow: what follows from it is not finite, and is asked for that."""
    return np.errstate(over="ignore", invalid="ignore")


@eqx.filter_jit
def _beliefs(posterior: Posterior, vector: Float[Numbers, " q"]) -> Quadratic:
    return posterior._beliefs(vector)


def _total(parts: _Parts, places: tuple[EvidenceCoordinates, ...], prior: _Prior) -> Quadratic:
    """The cost of all evidence and of the weak prior."""
    xp, (parts, prior) = known(parts, prior)
    (evaluations, counts, weights, loss, fitted), (vector, start, stiff) = parts, prior
    off, size = (vector - start) * stiff, vector.shape[0]
    # The starting deflection of a held-out recording is fitted to it, but is no part of the fit's cost.
    counted = xp.concatenate([xp.ones(size - sum(place.rows for place in places)), *_rows(fitted, places)])
    total = Quadratic(0.5 * xp.sum(counted * off**2), off * stiff, xp.diag(stiff**2))
    for one, count, weight, place, rows in zip(evaluations, counts, weights, places, fitted, strict=True):
        total += quadratic_of(one, count, loss, weight, place, rows)
    return total


def _rows(
    fitted: tuple[Float[Numbers, "..."], ...], places: tuple[EvidenceCoordinates, ...]
) -> list[Float[Numbers, "..."]]:
    return [own[: place.rows] for own, place in zip(fitted, places, strict=True)]
