"""Evidence: what was measured, as errors of a drive over their standard deviations. One kind of data a class."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Array, Float, Key

from frictionjax.physics import Drive


class AbstractEvidence(eqx.Module):
    """One kind of data. Its errors stand in blocks, which a loss judges together."""

    @property
    @abstractmethod
    def rows(self) -> int:
        """Recordings with a starting deflection of their own: coordinates of the fit beside the parameters."""

    @abstractmethod
    def errors(self, drive: Drive, z0: Float[Array, " rows"]) -> Float[Array, "b n"]:
        """Errors of `drive` over their standard deviations, 0 where not scored, shape `(b, n)`; `z0` is the starting
        deflection of each row over Fs/sigma0."""

    @property
    @abstractmethod
    def count(self) -> Float[Array, " b"]:
        """Scored numbers in each block, shape `(b,)`."""

    @property
    @abstractmethod
    def log_deviation(self) -> Float[Array, " b"]:
        """Sum of the logarithms of the standard deviations of the scored numbers in each block, shape `(b,)`."""


class AbstractMeasurement(AbstractEvidence):
    """Evidence with a noise of its own: other data, as likely under a model, can be drawn from it."""

    @abstractmethod
    def replica(self, drive: Drive, z0: Float[Array, " rows"], key: Key[Array, ""]) -> "AbstractMeasurement":
        """The same measurement made again on `drive`, which starts at `z0`: data drawn with `key` from the model and
        the noise."""
