"""Positions of a driven machine: innovations of a fixed-gain observer, which tolerates a model that is far off."""

import dataclasses

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers, known
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.pieces import Piece, lanes_of
from frictionjax.estimation.evidence.base import AbstractRecordings
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation import Gains, innovation_gain, innovations, left_by_observer, observer_gains
from frictionjax.simulation.lanes import innovations_side_by_side

_EXPLODED = 30.0
"""Times the innovations without any model: the most by which one coordinate of the model, a factor e of a parameter,
may change an innovation, if its derivative is to mean anything."""


class Observed(AbstractRecordings):
    """Recordings of position side by side, and the gains of the observer that predicts them.

    **Attributes:** `batch`, `gains` (shape `(r,)`), `pace` (bandwidth of each recording's observer over the one that is
    asked for, shape `(r,)`).
    """

    batch: Batch
    gains: Gains
    pace: Float[Numbers, " r"]

    def piece(self, piece: Piece) -> "Observed":
        """The recordings of a `piece`, of its shape."""
        gains, pace = lanes_of((self.gains, self.pace), piece)
        return Observed(self.batch.piece(piece), gains, pace)

    def standardised(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "rows n"]:
        """Innovations of an observer of `drive`, which starts at `z0` (over Fs/sigma0), over their standard deviation
        under the sensor's noise alone."""
        batch = self.batch

        def one(
            u: Float[Numbers, " n"],
            x: Float[Numbers, " n"],
            dt: Float[Numbers, ""],
            gains: Gains,
            start: tuple[Float[Numbers, ""], Float[Numbers, ""], Float[Numbers, ""], Before],
        ) -> Float[Numbers, " n"]:
            force = drive.applied_force(u, dt)
            return innovations(drive, force, x, dt, gains, start, substeps=batch.steps, samples=batch.samples)

        raw = batch.each(one, self.gains, z0 * drive.friction.Fs / drive.friction.sigma0)
        return raw / (batch.noise * innovation_gain(self.gains))[:, None] * batch.valid

    def side_by_side(self, drives: Drive, z0: Float[Numbers, "k rows"]) -> Float[Numbers, "k rows n"]:
        """The same of `k` `drives`, which start at `z0`, as rows of one batch."""
        batch = self.batch
        deflection = z0 * (drives.friction.Fs / drives.friction.sigma0)[:, None]
        start = (batch.x0, batch.v0, deflection, batch.before)
        raw = innovations_side_by_side(
            drives,
            batch.u,
            batch.x,
            batch.dt,
            self.gains,
            start,
            substeps=batch.steps,
            samples=batch.samples,
        )
        return raw / (batch.noise * innovation_gain(self.gains))[None, :, None] * batch.valid[None]

    def with_substeps(self, substeps: int) -> "Observed":
        """The same recordings with so many integration `substeps` a sample."""
        return dataclasses.replace(self, batch=self.batch.with_substeps(substeps))

    def at_bandwidth(self, bandwidth: float, *, pace: Float[Numbers, " rows"] | None = None) -> "Observed":
        """The same recordings through an observer of `bandwidth` Hz times their `pace` (None: as it is), or as fast as
        their sample rate allows."""
        return observed(self.batch, bandwidth, pace=self.pace if pace is None else pace)

    @property
    def bandwidth(self) -> Float[np.ndarray, " rows"]:
        """Bandwidth of the observer of each recording, Hz."""
        return -0.5 * np.log1p(-np.asarray(self.gains.position)) / (2.0 * np.pi * np.asarray(self.batch.dt))

    @property
    def largest_derivative(self) -> Float[np.ndarray, " rows"]:
        """So many times the largest innovation without a model: no parameter can do more than replace the whole motion
        by another."""
        return _EXPLODED * np.max(np.abs(self.without_model()), axis=1)

    def without_model(self) -> Float[np.ndarray, "rows n"]:
        """Standardised innovations of an observer that expects every machine to keep its speed (`left_by_observer`)."""
        batch, gains = self.batch, self.gains
        unit = np.asarray(batch.noise * innovation_gain(gains))
        x, steps = np.asarray(batch.x), np.arange(batch.x.shape[1])
        travel = (
            np.asarray(batch.x0)[:, None] + (np.asarray(batch.v0) * np.asarray(batch.dt))[:, None] * steps
        )
        return left_by_observer(x - travel, gains) / unit[:, None] * np.asarray(batch.valid)

    def with_input(self, more: Float[np.ndarray, "rows n"]) -> "Observed":
        """The same positions with `more` input, held over each sample."""
        pushed = dataclasses.replace(self.batch, u=np.asarray(self.batch.u) + more)
        return dataclasses.replace(self, batch=pushed)

    def with_noise(self, white: Float[np.ndarray, "rows n"]) -> "Observed":
        """The same inputs with more noise of the position: `white` times its standard deviation."""
        x = np.asarray(self.batch.x) + np.asarray(self.batch.noise)[:, None] * white
        return dataclasses.replace(self, batch=dataclasses.replace(self.batch, x=x))

    def noise_alone(self, rng: np.random.Generator) -> Float[np.ndarray, "rows n"]:
        """Standardised innovations of a free mass that does not move, of white noise from `rng` (`innovation_gain`)."""
        white = rng.standard_normal(self.batch.x.shape)
        return left_by_observer(white, self.gains) / np.asarray(innovation_gain(self.gains))[:, None]


def observed(batch: Batch, bandwidth: float, *, pace: Float[Numbers, " r"] | None = None) -> Observed:
    """The recordings of `batch` through an observer of `bandwidth` Hz times the `pace` of each (1 where it is None), or
    as fast as their sample rate allows."""
    xp, (dt,) = known(batch.dt)
    own: Float[Numbers, " r"] = xp.ones_like(dt) if pace is None else pace
    return Observed(batch, observer_gains(xp.minimum(bandwidth * own, 0.1 / dt), dt), own)
