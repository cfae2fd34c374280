"""Positions of a driven machine: innovations of an observer with given gains, which tolerates a model that is far
off."""

import dataclasses

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers, known
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.pieces import Piece, lanes_of, padded
from frictionjax.estimation.evidence.base import AbstractRecordings
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.simulation import (
    ObserverGains,
    innovation_gain,
    innovations,
    left_by_observer,
    left_by_varying_observer,
    observer_gains,
    sensor_noise,
)
from frictionjax.simulation.lanes import innovations_side_by_side

_EXPLODED = 30.0
"""Times the innovations without any model: the most by which one coordinate of the model, a factor e of a parameter,
may change an innovation, if its derivative is to mean anything."""


class Schedule(eqx.Module):
    """Gains that a Kalman filter asks for along each recording, for observers of at most so many Hz.

    **Attributes:** `gains` (shape `(r, n)`), `unit` (standard deviation of the innovations over that of the sensor's
    noise, shape `(r, n)`), `band` (bandwidth of the same filter for a free mass, Hz, shape `(r,)`), `used` (which
    recordings it is for, shape `(r,)`), `fastest` (bandwidth of the fastest observer that it replaces, Hz).
    """

    gains: ObserverGains
    unit: Float[Numbers, "r n"]
    band: Float[np.ndarray, " r"]
    used: Bool[np.ndarray, " r"]
    fastest: float = eqx.field(static=True)


class Observed(AbstractRecordings):
    """Recordings of position side by side, and the gains of the observer that predicts them.

    **Attributes:** `batch`; `gains` (one per sample, shape `(r, n)`); `unit` (standard deviation of the innovations of
    a perfect model over that of the sensor's noise, shape `(r, n)`); `band` (bandwidth of the observer, Hz: that for a
    free mass where the gains vary, shape `(r,)`); `pace` (bandwidth of each recording's observer over the one that is
    asked for, shape `(r,)`); `varies` (whether the gains of a recording vary, shape `(r,)`); `schedule` (of slow
    observers; None where all gains are constant).
    """

    batch: Batch
    gains: ObserverGains
    unit: Float[Numbers, "r n"]
    band: Float[Numbers, " r"]
    pace: Float[Numbers, " r"]
    varies: Bool[Numbers, " r"]
    schedule: Schedule | None = None

    def piece(self, piece: Piece) -> "Observed":
        """The recordings of a `piece`, of its shape, without the schedule."""
        gains = ObserverGains(padded(self.gains.position, piece), padded(self.gains.velocity, piece))
        numbers = lanes_of((self.band, self.pace, self.varies), piece)
        return Observed(self.batch.piece(piece), gains, padded(self.unit, piece), *numbers)

    def over_noise(self, raw: Float[Numbers, "*k rows n"]) -> Float[Numbers, "*k rows n"]:
        """Innovations `raw`, position units, over their standard deviation for a perfect model; 0 where not scored."""
        several = (1,) * (raw.ndim - 2)
        unit, valid = self.batch.noise[:, None] * self.unit, self.batch.valid
        return raw / unit.reshape(*several, *unit.shape) * valid.reshape(*several, *valid.shape)

    def standardised(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "rows n"]:
        """Innovations of an observer of `drive`, which starts at `z0` (over Fs/sigma0), over their standard deviation
        for a perfect model."""
        batch = self.batch

        def one(
            u: Float[Numbers, " n"],
            x: Float[Numbers, " n"],
            dt: Float[Numbers, ""],
            gains: ObserverGains,
            start: tuple[Float[Numbers, ""], Float[Numbers, ""], Float[Numbers, ""], Before],
        ) -> Float[Numbers, " n"]:
            force = drive.applied_force(u, dt)
            return innovations(drive, force, x, dt, gains, start, substeps=batch.steps, samples=batch.samples)

        raw = batch.each(one, self.gains, z0 * drive.friction.Fs / drive.friction.sigma0)
        return self.over_noise(raw)

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
        return self.over_noise(raw)

    def first(self, samples: int) -> "Observed":
        """The first so many `samples` of each recording (`Batch.first`)."""
        batch = self.batch.first(samples)
        most = batch.x.shape[1]
        arrays = (self.gains, self.unit, self.schedule and (self.schedule.gains, self.schedule.unit))
        gains, unit, planned = jax.tree.map(lambda leaf: np.asarray(leaf)[:, :most], arrays)
        schedule = self.schedule and dataclasses.replace(self.schedule, gains=planned[0], unit=planned[1])
        return dataclasses.replace(self, batch=batch, gains=gains, unit=unit, schedule=schedule)

    def with_substeps(self, substeps: int) -> "Observed":
        """The same recordings with so many integration `substeps` a sample."""
        return dataclasses.replace(self, batch=self.batch.with_substeps(substeps))

    def at_bandwidth(self, bandwidth: float, *, pace: Float[Numbers, " rows"] | None = None) -> "Observed":
        """The same recordings through an observer of `bandwidth` Hz times their `pace` (None: as it is), or as fast as
        their sample rate allows; through that of their schedule where it is for observers as slow as this."""
        constant = observed(self.batch, bandwidth, pace=self.pace if pace is None else pace)
        return constant if self.schedule is None else constant.scheduled(self.schedule, bandwidth)

    def scheduled(self, schedule: Schedule, bandwidth: float) -> "Observed":
        """The same with a `schedule`, which holds if the `bandwidth` that is asked for is as low."""
        if bandwidth > schedule.fastest:
            return dataclasses.replace(self, schedule=schedule)
        varies = np.asarray(schedule.used)
        this, usual = (schedule.gains, schedule.unit), (self.gains, self.unit)
        gains, unit = jax.tree.map(lambda one, other: np.where(varies[:, None], one, other), this, usual)
        band = np.where(varies, schedule.band, self.band)
        return dataclasses.replace(self, gains=gains, unit=unit, band=band, varies=varies, schedule=schedule)

    @property
    def bandwidth(self) -> Float[np.ndarray, " rows"]:
        """Bandwidth of the observer of each recording, Hz."""
        return np.asarray(self.band)

    @property
    def _steady(self) -> ObserverGains:
        """The constant gains of the `bandwidth`."""
        return observer_gains(np.asarray(self.band), np.asarray(self.batch.dt))

    @property
    def largest_derivative(self) -> Float[np.ndarray, " rows"]:
        """So many times the largest innovation without a model: no parameter can do more than replace the whole motion
        by another."""
        return _EXPLODED * np.max(np.abs(self.without_model()), axis=1)

    def without_model_as_observed(self) -> Float[np.ndarray, "rows n"]:
        """The same as `without_model` with the gains of the recordings, also where they vary."""
        batch = self.batch
        x, steps = np.asarray(batch.x), np.arange(batch.x.shape[1])
        travel = (np.asarray(batch.v0) * np.asarray(batch.dt))[:, None] * steps
        left = left_by_varying_observer(x - np.asarray(batch.x0)[:, None] - travel, self.gains, batch.dt)
        return np.asarray(self.over_noise(np.asarray(left)))

    def without_model(self) -> Float[np.ndarray, "rows n"]:
        """Standardised innovations of an observer that expects every machine to keep its speed (`left_by_observer`)."""
        batch, gains = self.batch, self._steady
        unit = np.asarray(batch.noise * innovation_gain(gains, batch.integrated))
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
        """The same inputs with more noise of the position: `white` times its standard deviation, or a random walk of it
        (`sensor_noise`)."""
        more = sensor_noise(white, self.batch.integrated)
        x = np.asarray(self.batch.x) + np.asarray(self.batch.noise)[:, None] * more
        return dataclasses.replace(self, batch=dataclasses.replace(self.batch, x=x))

    def noise_alone(self, rng: np.random.Generator) -> Float[np.ndarray, "rows n"]:
        """Standardised innovations of a free mass that does not move, of the sensor's noise alone, from `rng`
        (`innovation_gain`)."""
        integrated = self.batch.integrated
        noise = sensor_noise(rng.standard_normal(self.batch.x.shape), integrated)
        unit = np.asarray(innovation_gain(self._steady, integrated))
        return left_by_observer(noise, self._steady) / unit[:, None]


def observed(batch: Batch, bandwidth: float, *, pace: Float[Numbers, " r"] | None = None) -> Observed:
    """The recordings of `batch` through an observer of `bandwidth` Hz times the `pace` of each (1 where it is None), or
    as fast as their sample rate allows."""
    xp, (dt,) = known(batch.dt)
    own: Float[Numbers, " r"] = xp.ones_like(dt) if pace is None else pace
    band = xp.minimum(bandwidth * own, 0.1 / dt)
    gains, shape = observer_gains(band, dt), batch.x.shape
    unit = xp.broadcast_to(xp.asarray(innovation_gain(gains, batch.integrated))[:, None], shape)
    return Observed(batch, gains.along(*shape), unit, band, own, xp.zeros(dt.shape, dtype=bool))
