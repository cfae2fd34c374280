"""Positions of a machine that is driven by a known force: prediction errors of a Kalman filter with given gains."""

import os
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key

from frictionjax.core.arrays import Numbers, numpy_or_jax
from frictionjax.core.arrays import known as known_numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.core.programs import compiled
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.data.pieces import Piece, padded, pieces_of, put_in_order, put_together
from frictionjax.estimation.evidence.base import AbstractMeasurement
from frictionjax.physics import Drive
from frictionjax.simulation.kalman import driven_by, kalman_filter, predicted_with
from frictionjax.simulation.ros2 import Substeps

_HEAD = 0.01  # s: what `make_batch` reads the first position and velocity from
_WIDE = 3.0  # times the standard deviation of that reading: nearly no prior, so that no sample counts twice


class Positions(AbstractMeasurement):
    """Recordings of position side by side, and the gains and standard deviations of their prediction errors.

    The gains are computed beforehand (`filtered`) and not differentiated: their dependence on the parameters multiplies
    innovations of mean zero.

    **Attributes:** `batch`; `gain`, shape `(r, n, m)`; `deviation` of the prediction errors, position units, shape
    `(r, n)`; `substeps` per sample.
    """

    batch: Batch
    gain: Float[Numbers, "r n m"]
    deviation: Float[Numbers, "r n"]
    substeps: int = eqx.field(static=True)

    @property
    def rows(self) -> int:
        """Recordings."""
        return self.batch.x.shape[0]

    @property
    def samples(self) -> int:
        """Samples to which the recordings are padded."""
        return self.batch.x.shape[1]

    def pieces(self) -> tuple[Piece, ...]:
        """The recordings in pieces of a few fixed shapes."""
        return pieces_of(self.batch.lengths)

    def piece(self, piece: Piece) -> "Positions":
        """The recordings of a `piece`, of its shape."""
        batch = self.batch.with_substeps(self.substeps).piece(piece)
        return Positions(batch, padded(self.gain, piece), padded(self.deviation, piece), 0)

    @property
    def count(self) -> Float[Numbers, " b"]:
        """Scored samples in each block, shape `(b,)`."""
        return self.batch.block_count.ravel()

    @property
    def log_deviation(self) -> Float[Numbers, " b"]:
        """Sum of the logarithms of the standard deviations of the scored samples in each block, shape `(b,)`."""
        xp, (valid, deviation) = known_numbers(self.batch.valid, self.deviation)
        return xp.sum((valid * xp.log(deviation)).reshape(-1, self.batch.block), axis=1)

    @property
    def steps(self) -> Substeps:
        """Integration steps a sample."""
        return self.substeps if self.batch.run is None else self.batch.run.substeps

    def errors(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "b n"]:
        """Prediction errors of `drive` over their standard deviations, shape `(b, n)`; `z0` over Fs/sigma0."""
        batch = self.batch
        deflection = z0 * drive.friction.Fs / drive.friction.sigma0

        def one(
            u: Float[Numbers, " n"],
            x: Float[Numbers, " n"],
            dt: Float[Numbers, ""],
            x0: Float[Numbers, ""],
            v0: Float[Numbers, ""],
            z: Float[Numbers, ""],
            gain: Float[Numbers, "n m"],
        ) -> Float[Numbers, " n"]:
            force = drive.applied_force(u, dt)
            steps, samples = self.steps, batch.samples
            return predicted_with(drive, force, x, dt, gain, (x0, v0, z), substeps=steps, samples=samples)

        raw = jax.vmap(one)(batch.u, batch.x, batch.dt, batch.x0, batch.v0, deflection, self.gain)
        return (raw / self.deviation * batch.valid).reshape(-1, batch.block)

    def replica(self, drive: Drive, z0: Float[Numbers, " rows"], key: Key[Array, ""]) -> "Positions":
        """The recordings made again on `drive` from `z0` with the same input: innovations drawn with `key` stand for
        sensor noise and unmeasured force, and the gains of the filter propagate them, as in its model."""
        batch = self.batch
        deflection = z0 * drive.friction.Fs / drive.friction.sigma0
        drawn = self.deviation * jax.random.normal(key, batch.x.shape)

        def one(
            u: Float[Numbers, " n"],
            dt: Float[Numbers, ""],
            x0: Float[Numbers, ""],
            v0: Float[Numbers, ""],
            z: Float[Numbers, ""],
            gain: Float[Numbers, "n m"],
            innovation: Float[Numbers, " n"],
        ) -> Float[Numbers, " n"]:
            force = drive.applied_force(u, dt)
            return driven_by(drive, force, innovation, dt, gain, (x0, v0, z), substeps=self.substeps)

        x = jax.vmap(one)(batch.u, batch.dt, batch.x0, batch.v0, deflection, self.gain, drawn)
        return eqx.tree_at(lambda e: e.batch.x, self, x)


class Noise(PlainMethods, eqx.Module):
    """The two noises of each recording.

    **Attributes:** `position`: standard deviation of the measured position, position units; `push`: of the unmeasured
    force (all that acts on the machine and is neither the input nor in the model), constant over each sample, force
    units; `best`: the likeliest ratio of the two, interpolated between those that were tried; shape `(r,)` each.
    """

    position: Float[Numbers, "*d r"]
    push: Float[Numbers, "*d r"]
    best: Float[Numbers, "*d r"]


def scored_from_the_start(batch: Batch) -> Batch:
    """The same `batch` with every sample scored: the variance of a Kalman filter covers its start."""
    xp = numpy_or_jax(batch)  # of many data sets at once it is compiled
    inside = xp.arange(batch.x.shape[1])[None] < batch.lengths[:, None]
    return eqx.tree_at(lambda b: b.valid, batch, xp.asarray(inside, dtype=float))


def _top(
    ratios: Float[Numbers, " k"], costs: Float[Numbers, " k"], best: Int[Numbers, ""]
) -> Float[Numbers, ""]:
    """Ratio at the vertex of the parabola (over its logarithm) through the `best` candidate and its neighbours."""
    middle = jnp.clip(best, 1, ratios.shape[0] - 2)
    places = middle + jnp.array([-1, 0, 1])
    x, y = jnp.log(jnp.maximum(ratios[places], 1e-300)), costs[places]
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (0.5 * (x[2] - x[0]))
    vertex = 0.5 * (x[0] + x[1]) - left / bend
    usable = (
        (bend > 0.0)
        & jnp.all(jnp.isfinite(y))
        & (ratios[places[0]] > 0.0)
        & (vertex > x[0])
        & (vertex < x[2])
    )
    return jnp.where(usable, jnp.exp(jnp.where(usable, vertex, 0.0)), ratios[best])


@eqx.filter_jit
def filtered(
    drive: Drive,
    z0: Float[Numbers, " r"],
    batch: Batch,
    ratio: Float[Numbers, "r k"],
    known: Bool[Numbers, " r"],
    substeps: int,
) -> tuple[Positions, Noise]:
    """Gains of the likeliest of k ratios of unmeasured force to position noise, for each recording on its own.

    For a given ratio the likelihood determines both: s^2 = mean of e^2/S, cost = n log s + 1/2 sum of log S.

    **Arguments:**

    - `drive`: the present model.
    - `z0`: starting deflections over Fs/sigma0, shape `(r,)`.
    - `batch`: the recordings, scored from the start.
    - `ratio`: candidates, force over position, shape `(r, k)`.
    - `known`: recordings whose position noise is given and not to be scaled, shape `(r,)`.
    - `substeps`: integration steps per sample.

    **Returns:**

    The `Positions` with these gains, and their `Noise`.
    """
    gain, deviation, noise = _searched(drive, z0, batch.with_substeps(substeps), ratio, known)
    return Positions(batch, gain, deviation, substeps), noise


def _searched(
    drive: Drive,
    z0: Float[Numbers, " r"],
    batch: Batch,
    ratio: Float[Numbers, "r k"],
    known: Bool[Numbers, " r"],
    recovers: bool = False,
) -> tuple[Float[Numbers, "r n m"], Float[Numbers, "r n"], Noise]:
    """Gains, deviations of the prediction errors, and noise of `filtered`, with the integration steps of the `batch`;
    `recovers` as in `kalman_filter`, other arguments as there."""
    deflection = z0 * drive.friction.Fs / drive.friction.sigma0

    def one(
        u: Float[Numbers, " n"],
        x: Float[Numbers, " n"],
        dt: Float[Numbers, ""],
        noise: Float[Numbers, ""],
        x0: Float[Numbers, ""],
        v0: Float[Numbers, ""],
        z: Float[Numbers, ""],
        integrated: Bool[Numbers, ""],
        valid: Float[Numbers, " n"],
        given: Bool[Numbers, ""],
        ratios: Float[Numbers, " k"],
    ) -> tuple[
        Float[Numbers, "n m"],
        Float[Numbers, " n"],
        Float[Numbers, ""],
        Float[Numbers, ""],
        Float[Numbers, ""],
    ]:
        force = drive.applied_force(u, dt)
        head = jnp.maximum(_HEAD / dt, 10.0)
        # A machine that is read as moving may as well be setting off: then the reading is a mean over the way.
        sure = _WIDE * noise / jnp.sqrt(head)
        spread = (sure + jnp.abs(v0) * head * dt, sure * jnp.sqrt(12.0) / (head * dt) + jnp.abs(v0))
        samples = jnp.sum(valid)

        def lane(
            quotient: Float[Numbers, ""],
        ) -> tuple[Float[Numbers, "n m"], Float[Numbers, " n"], Float[Numbers, ""], Float[Numbers, ""]]:
            found = kalman_filter(
                drive,
                force,
                x,
                dt,
                noise,
                quotient * noise,
                (x0, v0, z),
                spread,
                integrated=integrated,
                substeps=batch.steps,
                samples=batch.samples,
                recovers=recovers,
            )
            # Beyond the samples that are run there is no variance.
            relative = jnp.where(valid > 0.0, found.variance / noise**2, 1.0)
            left = jnp.sum(valid * found.innovation**2 / relative) / samples
            size = jnp.where(given, noise**2, left)
            cost = 0.5 * (samples * (jnp.log(size) + left / size) + jnp.sum(valid * jnp.log(relative)))
            return found.gain, jnp.sqrt(relative * size), jnp.sqrt(size), cost

        gains, deviations, sizes, costs = jax.vmap(lane)(ratios)
        costs = jnp.where(jnp.isfinite(costs), costs, jnp.inf)
        best = jnp.argmin(costs)
        top = _top(ratios, costs, best)
        return gains[best], deviations[best], sizes[best], ratios[best] * sizes[best], top

    gain, deviation, size, push, top = jax.vmap(one)(
        batch.u,
        batch.x,
        batch.dt,
        batch.noise,
        batch.x0,
        batch.v0,
        deflection,
        batch.integrated,
        batch.valid,
        known,
        ratio,
    )
    return gain, deviation, Noise(size, push, top)


_searched_in_piece = compiled()(_searched)


def filtered_in_pieces(
    drive: Drive,
    z0: Float[np.ndarray, " r"],
    batch: Batch,
    ratio: Float[np.ndarray, "r k"],
    known: Bool[np.ndarray, " r"],
    substeps: int,
    recovers: bool = False,
) -> tuple[Positions, Noise]:
    """`filtered`, two recordings at a time, for which one program is compiled, and on all cores.

    **Arguments:**

    - `drive`, `z0`, `batch`, `ratio`, `known`, `substeps`: as in `filtered`; `recovers`: as in `kalman_filter`.

    **Returns:**

    The `Positions` and their `Noise`.
    """
    pieces, finer = pieces_of(batch.lengths, pairs=True), batch.with_substeps(substeps)
    z0, ratio, known = (np.asarray(own) for own in (z0, ratio, known))

    def run(piece: Piece) -> tuple[Float[Numbers, "w n m"], Float[Numbers, "w n"], Noise]:
        own = (z0[piece.lanes], finer.piece(piece), ratio[piece.lanes], known[piece.lanes])
        return jax.block_until_ready(_searched_in_piece(drive, *own, recovers=recovers))

    with ThreadPoolExecutor(min(len(pieces), os.cpu_count() or 1)) as threads:
        parts = list(zip(pieces, threads.map(run, pieces), strict=True))
    gain, deviation = (
        put_together([(piece, found[place]) for piece, found in parts], *batch.x.shape) for place in (0, 1)
    )
    noise = {
        name: put_in_order([(piece, getattr(found[2], name)) for piece, found in parts], batch.x.shape[0])
        for name in ("position", "push", "best")
    }
    deviation = np.where(deviation > 0.0, deviation, 1.0)
    return Positions(batch, gain, deviation, substeps), Noise(**noise)
