"""Friction forces of a machine whose motion is imposed, as on a tribometer."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from frictionjax.core.arrays import Numbers, known
from frictionjax.core.programs import compiled
from frictionjax.estimation.data.batch import BLOCK
from frictionjax.estimation.data.pieces import Piece, lanes_of, padded, pieces_of
from frictionjax.estimation.evidence.base import AbstractMeasurement
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import imposed_friction

# Part of the force's standard deviation that the first noise level is at least: no model of friction comes nearer to a
# machine, and with a sensor's noise far below it the descent would follow the few blocks that fit best.
_FIRST_NOISE = 0.01
_LEAST = 1e-9  # of the force's standard deviation: less noise is rounding


class Forces(AbstractMeasurement):
    """Recordings of imposed position and measured friction force, padded to one length.

    **Attributes:** `x` (position units), `force`, `valid` (1 where scored), shape `(r, n)`; `dt` (s), `noise` of the
    force and `known`, the same where it is given and else nan, shape `(r,)`; `block` (samples), `lengths` (samples of
    each recording), `substeps` per sample, `run_along`: so many samples
    (of a piece; None: all).
    """

    x: Float[Numbers, "r n"]
    force: Float[Numbers, "r n"]
    valid: Float[Numbers, "r n"]
    dt: Float[Numbers, " r"]
    noise: Float[Numbers, " r"]
    known: Float[Numbers, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    substeps: int = eqx.field(static=True, default=1)
    run_along: Int[Numbers, ""] | None = None

    @property
    def samples(self) -> int:
        """Samples to which the recordings are padded."""
        return self.x.shape[1]

    def pieces(self) -> tuple[Piece, ...]:
        """The recordings in pieces of a few fixed shapes."""
        return pieces_of(self.lengths)

    def piece(self, piece: Piece) -> "Forces":
        """The recordings of a `piece`, of its shape; their motion goes on with its last velocity."""
        return Forces(
            x=padded(self.x, piece, "line"),
            force=padded(self.force, piece),
            valid=padded(self.valid, piece, "zero"),
            **lanes_of({name: getattr(self, name) for name in ("dt", "noise", "known")}, piece),
            block=1,
            lengths=self.lengths[piece.lanes],
            substeps=self.substeps,
            run_along=np.asarray(piece.samples),
        )

    @property
    def rows(self) -> int:
        """Recordings."""
        return self.x.shape[0]

    @property
    def count(self) -> Float[Numbers, " b"]:
        """Scored samples in each block, shape `(b,)`."""
        xp, (valid,) = known(self.valid)
        return xp.sum(valid.reshape(-1, self.block), axis=1)

    @property
    def log_deviation(self) -> Float[Numbers, " b"]:
        """Sum of the logarithms of the noise of the scored samples in each block, shape `(b,)`."""
        xp, (valid, noise) = known(self.valid, self.noise)
        return xp.sum((valid * xp.log(noise)[:, None]).reshape(-1, self.block), axis=1)

    def errors(self, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Numbers, "b n"]:
        """Modelled less measured force of `drive` over its noise, shape `(b, n)`; `z0` over Fs/sigma0."""
        deflection = z0 * drive.friction.Fs / drive.friction.sigma0

        def one(
            x: Float[Numbers, " n"], dt: Float[Numbers, ""], z: Float[Numbers, ""]
        ) -> Float[Numbers, " n"]:
            return imposed_friction(drive, x, dt, z, substeps=self.substeps, samples=self.run_along)

        raw = jax.vmap(one)(self.x, self.dt, deflection) - self.force
        return (raw / self.noise[:, None] * self.valid).reshape(-1, self.block)

    def with_noise_of(self, drive: Drive, z0: Float[Numbers, " rows"]) -> "Forces":
        """The same data with the noise that `drive` leaves in each recording, or that is known; `z0` as in `errors`."""
        return eqx.tree_at(lambda e: e.noise, self, _noise_of(self, drive, z0))

    def replica(self, drive: Drive, z0: Float[Numbers, " rows"], key: Key[Array, ""]) -> "Forces":
        """The friction of `drive` in the same motion from `z0`, with noise drawn with `key`."""
        error = self.errors(drive, z0).reshape(self.valid.shape) * self.noise[:, None]
        drawn = self.force + error + self.noise[:, None] * jax.random.normal(key, self.force.shape)
        return eqx.tree_at(lambda e: e.force, self, drawn)


@compiled()
def _noise_of(forces: Forces, drive: Drive, z0: Float[Numbers, " rows"]) -> Float[Array, " r"]:
    """The noise that `drive` leaves in each recording of the `forces`, or that is known."""
    error = (forces.errors(drive, z0).reshape(forces.valid.shape) * forces.noise[:, None]) ** 2
    samples = jnp.sum(forces.valid, axis=1)
    spread = jnp.sqrt(jnp.sum(error, axis=1) / samples)
    level = jnp.sqrt(jnp.sum(forces.force**2 * forces.valid, axis=1) / samples)
    found = jnp.maximum(spread, _LEAST * level)
    return jnp.where(jnp.isnan(forces.known), found, forces.known)


def make_forces(recordings: tuple[Recording, ...], given: tuple[float | None, ...] | None = None) -> Forces:
    """Motion-driven `recordings` side by side in `Forces`; their first noise is that of the force's fourth differences,
    or more. `given`: noise of each that is known, or None."""
    rate = float(np.median([r.sample_rate for r in recordings]))
    block = max(round(BLOCK * rate), 8)
    longest = max(r.x.size for r in recordings)
    whole = -(-longest // block) * block

    def side_by_side(channels: list[Float[np.ndarray, "..."]]) -> Float[np.ndarray, "r n"]:
        return np.stack([np.pad(c, (0, whole - c.size), mode="edge") for c in channels])

    forces = [np.asarray(r.force) for r in recordings]
    lengths = np.array([r.x.size for r in recordings])
    noise = [
        max(float(np.std(np.diff(f, 4))) / np.sqrt(70.0), _FIRST_NOISE * float(np.std(f)), 1e-300)
        for f in forces
    ]
    levels = [np.nan if level is None else level for level in given or (None,) * len(forces)]
    return Forces(
        x=side_by_side([r.x for r in recordings]),
        force=side_by_side(forces),
        valid=np.asarray(np.arange(whole)[None] < lengths[:, None], dtype=float),
        dt=np.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=np.asarray(noise),
        known=np.asarray(levels, dtype=float),
        block=block,
        lengths=lengths,
    )
