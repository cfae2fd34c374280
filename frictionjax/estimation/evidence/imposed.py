"""Friction forces under an imposed motion, with a known noise level: evidence of a diagnosis."""

import dataclasses

import jax
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.data.pieces import Piece
from frictionjax.estimation.evidence.base import AbstractRecordings
from frictionjax.physics import Drive


class Imposed(AbstractRecordings):
    """Recordings of an imposed motion and of the measured friction force.

    **Attributes:** `batch`.
    """

    batch: ImposedBatch

    def piece(self, piece: Piece) -> "Imposed":
        """The recordings of a `piece`, of its shape."""
        return Imposed(self.batch.piece(piece))

    def standardised(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "rows n"]:
        """Measured less modelled force of `drive`, which starts at `z0` (over Fs/sigma0), over its noise."""
        batch = self.batch
        errors = batch.force - batch.along(drive, z0 * drive.friction.Fs / drive.friction.sigma0)[2]
        return errors / (batch.ease * batch.noise)[:, None] * batch.valid

    def side_by_side(self, drives: Drive, z0: Float[Numbers, "k rows"]) -> Float[Numbers, "k rows n"]:
        """The same of `k` `drives`, which start at `z0`."""
        return jax.vmap(self.standardised)(drives, z0)

    def with_substeps(self, substeps: int) -> "Imposed":
        """The same: runs along an imposed motion choose their own `substeps`."""
        return self

    def at_bandwidth(self, bandwidth: float, *, pace: Float[Numbers, " rows"] | None = None) -> "Imposed":
        """The same, whatever the `bandwidth` and the `pace`: there is no observer."""
        return self

    @property
    def bandwidth(self) -> Float[np.ndarray, " rows"]:
        """Zeros: there is no observer."""
        return np.zeros(self.batch.dt.shape)

    @property
    def largest_derivative(self) -> Float[np.ndarray, " rows"]:
        """Infinite: the motion does not depend on the model."""
        return np.full(self.batch.dt.shape, np.inf)

    def with_input(self, more: Float[np.ndarray, "rows n"]) -> "Imposed":
        """The same: no input acts on an imposed motion, so that `more` of it changes nothing."""
        return self

    def with_noise(self, white: Float[np.ndarray, "rows n"]) -> "Imposed":
        """The same motion with more noise of the force: `white` times its standard deviation."""
        batch = self.batch
        noise = np.asarray(batch.ease * batch.noise)[:, None]
        return Imposed(dataclasses.replace(batch, force=np.asarray(batch.force) + noise * white))

    def noise_alone(self, rng: np.random.Generator) -> Float[np.ndarray, "rows n"]:
        """White noise from `rng`: nothing filters it."""
        return rng.standard_normal(self.batch.x.shape)

    def without_model(self) -> Float[np.ndarray, "rows n"]:
        """Standardised errors of a constant friction force."""
        batch = jax.device_get(self.batch)
        mean = np.sum(batch.force * batch.valid, axis=1) / np.sum(batch.valid, axis=1)
        return (batch.force - mean[:, None]) / (batch.noise * batch.ease)[:, None] * batch.valid
