"""Evidence: data, as prediction errors of a drive over their standard deviations. One kind of data a class."""

from abc import abstractmethod
from typing import TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Key

from frictionjax.core.arrays import Numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.data.pieces import Piece, kept, pieces_of
from frictionjax.physics import Drive

_E = TypeVar("_E", bound="AbstractEvidence")


class AbstractEvidence(PlainMethods, eqx.Module):
    """One kind of data. Its errors stand in blocks, which a loss judges together."""

    @property
    @abstractmethod
    def rows(self) -> int:
        """Recordings with a starting deflection of their own: coordinates of the fit beside the parameters."""

    @property
    @abstractmethod
    def samples(self) -> int:
        """Samples to which the recordings are padded; 0 for evidence without recordings."""

    @abstractmethod
    def errors(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "b n"]:
        """Errors of `drive` over their standard deviations, 0 where not scored, shape `(b, n)`; `z0` is the starting
        deflection of each row over Fs/sigma0."""

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """The recordings in pieces of a few fixed shapes; none for evidence without recordings."""

    @abstractmethod
    def piece(self: _E, piece: Piece) -> _E:
        """The evidence of the recordings of a `piece`, of its shape: its errors are not in blocks."""

    def in_pieces(self: _E) -> tuple[tuple[Piece, _E], ...]:
        """The recordings in `pieces`, each with its `piece` of the evidence; made once."""
        return kept(self, "pieces", lambda: tuple((piece, self.piece(piece)) for piece in self.pieces()))

    @property
    @abstractmethod
    def count(self) -> Float[Numbers, " b"]:
        """Scored numbers in each block, shape `(b,)`."""

    @property
    @abstractmethod
    def log_deviation(self) -> Float[Numbers, " b"]:
        """Sum of the logarithms of the standard deviations of the scored numbers in each block, shape `(b,)`."""


class AbstractMeasurement(AbstractEvidence):
    """Evidence with a noise of its own: other data, as likely under a model, can be drawn from it."""

    @abstractmethod
    def replica(
        self, drive: Drive, z0: Float[Numbers, " rows"], key: Key[Array, ""]
    ) -> "AbstractMeasurement":
        """The same measurement made again on `drive`, which starts at `z0`: data drawn with `key` from the model and
        the noise."""


class AbstractRecordings(AbstractEvidence):
    """Recordings side by side with a known noise level: what a diagnosis fits and tests.

    **Attributes:** `batch`.
    """

    batch: eqx.AbstractVar[AbstractBatch]

    @property
    def rows(self) -> int:
        """Recordings."""
        return self.batch.x.shape[0]

    def pieces(self) -> tuple[Piece, ...]:
        """The recordings in pieces of a few fixed shapes."""
        return pieces_of(self.batch.lengths)

    @property
    def count(self) -> Float[Numbers, " b"]:
        """Scored samples in each block, shape `(b,)`."""
        return self.batch.block_count.ravel()

    @property
    def log_deviation(self) -> Float[Numbers, " b"]:
        """Zeros, shape `(b,)`: the noise is not estimated."""
        return np.zeros(self.count.shape)

    @property
    def samples(self) -> int:
        """Samples to which the recordings are padded."""
        return self.batch.x.shape[1]

    def errors(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "b n"]:
        """The `standardised` errors of `drive`, which starts at `z0`, in blocks."""
        return self.standardised(drive, z0).reshape(-1, self.batch.block)

    @abstractmethod
    def standardised(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "rows n"]:
        """Prediction errors of `drive` over what the noise alone makes of them, 0 where not scored, shape `(rows, n)`:
        1 in the mean square for a perfect model, at any sample rate.

        **Arguments:**

        - `drive`: the `Drive`.
        - `z0`: bristle deflection at the first sample over the break-away deflection Fs/sigma0, shape `(rows,)`.
        """

    @abstractmethod
    def side_by_side(self, drives: Drive, z0: Float[Numbers, "k rows"]) -> Float[Numbers, "k rows n"]:
        """The `standardised` errors of `k` `drives`, leaves of shape `(k, ...)`, that start at `z0`."""

    @property
    @abstractmethod
    def bandwidth(self) -> Float[np.ndarray, " rows"]:
        """Bandwidth of the observer of each recording, Hz; 0 where there is none."""

    @abstractmethod
    def with_substeps(self, substeps: int) -> "AbstractRecordings":
        """The same recordings with so many integration `substeps` a sample. An imposed motion keeps its own."""

    @abstractmethod
    def at_bandwidth(
        self, bandwidth: float, *, pace: Float[Numbers, " rows"] | None = None
    ) -> "AbstractRecordings":
        """The same recordings through an observer of `bandwidth` Hz times the `pace` of each (None: as it is), where
        there is one."""

    @property
    @abstractmethod
    def largest_derivative(self) -> Float[np.ndarray, " rows"]:
        """Largest derivative of an error by one coordinate that can mean anything, in each recording."""

    @abstractmethod
    def with_input(self, more: Float[np.ndarray, "rows n"]) -> "AbstractRecordings":
        """The same measurements with `more` input, held over each sample."""

    @abstractmethod
    def with_noise(self, white: Float[np.ndarray, "rows n"]) -> "AbstractRecordings":
        """The same recordings with more noise of the measured output: `white` times its standard deviation."""

    @abstractmethod
    def noise_alone(self, rng: np.random.Generator) -> Float[np.ndarray, "rows n"]:
        """Standardised errors that white measurement noise of unit power makes, drawn from `rng`."""

    @abstractmethod
    def without_model(self) -> Float[np.ndarray, "rows n"]:
        """Standardised errors of a trivial model: what any model has to explain, shape `(rows, n)`."""
