"""Positions seen by the fixed-gain observer: forgiving evidence, for the way from a bad start to a good one."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.evidence.base import AbstractEvidence
from frictionjax.estimation.evidence.residuals import standardised
from frictionjax.physics import Drive
from frictionjax.simulation import Gains, observer_gains


class Observed(AbstractEvidence):
    """Recordings of position side by side, and the gains of their observer.

    **Attributes:** `batch`, `gains` (shape `(r,)`).
    """

    batch: Batch
    gains: Gains

    @property
    def rows(self) -> int:
        """Recordings."""
        return self.batch.x.shape[0]

    @property
    def count(self) -> Float[Array, " b"]:
        """Scored samples in each block, shape `(b,)`."""
        return self.batch.block_count.ravel()

    @property
    def log_deviation(self) -> Float[Array, " b"]:
        """Zeros, shape `(b,)`: the observer's noise is not estimated."""
        return jnp.zeros(self.count.shape)

    def errors(self, drive: Drive, z0: Float[Array, " rows"]) -> Float[Array, "b n"]:
        """Standardised innovations of `drive`, shape `(b, n)`; `z0` over Fs/sigma0."""
        return standardised(drive, z0, self.batch, self.gains).reshape(-1, self.batch.block)


def observed(batch: Batch, bandwidth: float) -> Observed:
    """The recordings of `batch` through an observer of `bandwidth` Hz, or as fast as their sample rate allows."""
    return Observed(batch, observer_gains(min(bandwidth, 0.1 / float(jnp.max(batch.dt))), batch.dt))
