"""Friction forces under an imposed motion, with a known noise level: evidence of a diagnosis."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.evidence.base import AbstractRecordings
from frictionjax.physics import Drive


class Imposed(AbstractRecordings):
    """Recordings of an imposed motion and of the measured friction force.

    **Attributes:** `batch`.
    """

    batch: ImposedBatch

    def standardised(
        self, drive: Drive, z0: Float[Array, " rows"], *, finer: int = 1
    ) -> Float[Array, "rows n"]:
        """Measured less modelled force of `drive`, which starts at `z0` (over Fs/sigma0), over its noise; runs along an
        imposed motion choose their own steps, whatever `finer` says."""
        batch = self.batch
        errors = batch.force - batch.run(drive, z0 * drive.friction.Fs / drive.friction.sigma0)[2]
        return errors / (batch.ease * batch.noise)[:, None] * batch.valid

    def side_by_side(self, drives: Drive, z0: Float[Array, "k rows"]) -> Float[Array, "k rows n"]:
        """The same of `k` `drives`, which start at `z0`."""
        return jax.vmap(self.standardised)(drives, z0)

    def at_bandwidth(self, bandwidth: float) -> "Imposed":
        """The same, whatever the `bandwidth`: there is no observer."""
        return self

    @property
    def largest_derivative(self) -> Float[Array, " rows"]:
        """Infinite: the motion does not depend on the model."""
        return jnp.full(self.batch.dt.shape, jnp.inf)

    def with_input(self, more: Float[np.ndarray, "rows n"]) -> "Imposed":
        """The same: no input acts on an imposed motion, so that `more` of it changes nothing."""
        return self

    def noise_alone(self, rng: np.random.Generator) -> Float[np.ndarray, "rows n"]:
        """White noise from `rng`: nothing filters it."""
        return rng.standard_normal(self.batch.x.shape)

    def without_model(self) -> Float[Array, "rows n"]:
        """Standardised errors of a constant friction force."""
        batch = self.batch
        mean = jnp.sum(batch.force * batch.valid, axis=1) / jnp.sum(batch.valid, axis=1)
        return (batch.force - mean[:, None]) / (batch.noise * batch.ease)[:, None] * batch.valid
