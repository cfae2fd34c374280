"""Friction forces of a machine whose motion is imposed, as on a tribometer."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key

from frictionjax.estimation.evidence.base import AbstractMeasurement
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import imposed_friction

_BLOCK = 0.05  # s
# Part of the force's standard deviation that the first noise level is at least: no model of friction comes nearer to a
# machine, and with a sensor's noise far below it the descent would follow the few blocks that fit best.
_FIRST_NOISE = 0.01
_LEAST = 1e-9  # of the force's standard deviation: less noise is rounding


class Forces(AbstractMeasurement):
    """Recordings of imposed position and measured friction force, padded to one length.

    **Attributes:** `x` (position units), `force`, `valid` (1 where scored), shape `(r, n)`; `dt` (s), `noise` of the
    force and `known`, the same where it is given and else nan, shape `(r,)`; `block` (samples), `lengths` (samples of
    each recording), `substeps` per sample.
    """

    x: Float[Array, "r n"]
    force: Float[Array, "r n"]
    valid: Float[Array, "r n"]
    dt: Float[Array, " r"]
    noise: Float[Array, " r"]
    known: Float[Array, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    substeps: int = eqx.field(static=True, default=1)

    @property
    def rows(self) -> int:
        """Recordings."""
        return self.x.shape[0]

    @property
    def count(self) -> Float[Array, " b"]:
        """Scored samples in each block, shape `(b,)`."""
        return jnp.sum(self.valid.reshape(-1, self.block), axis=1)

    @property
    def log_deviation(self) -> Float[Array, " b"]:
        """Sum of the logarithms of the noise of the scored samples in each block, shape `(b,)`."""
        return jnp.sum((self.valid * jnp.log(self.noise)[:, None]).reshape(-1, self.block), axis=1)

    def errors(self, drive: Drive, z0: Float[Array, " rows"]) -> Float[Array, "b n"]:
        """Modelled less measured force of `drive` over its noise, shape `(b, n)`; `z0` over Fs/sigma0."""
        deflection = z0 * drive.friction.Fs / drive.friction.sigma0

        def one(x: Float[Array, " n"], dt: Float[Array, ""], z: Float[Array, ""]) -> Float[Array, " n"]:
            return imposed_friction(drive, x, dt, z, substeps=self.substeps)

        raw = jax.vmap(one)(self.x, self.dt, deflection) - self.force
        return (raw / self.noise[:, None] * self.valid).reshape(-1, self.block)

    def with_noise_of(self, drive: Drive, z0: Float[Array, " rows"]) -> "Forces":
        """The same data with the noise that `drive` leaves in each recording, or that is known; `z0` as in `errors`."""
        error = (self.errors(drive, z0).reshape(self.valid.shape) * self.noise[:, None]) ** 2
        samples = jnp.sum(self.valid, axis=1)
        spread = jnp.sqrt(jnp.sum(error, axis=1) / samples)
        level = jnp.sqrt(jnp.sum(self.force**2 * self.valid, axis=1) / samples)
        found = jnp.maximum(spread, _LEAST * level)
        return eqx.tree_at(lambda e: e.noise, self, jnp.where(jnp.isnan(self.known), found, self.known))

    def replica(self, drive: Drive, z0: Float[Array, " rows"], key: Key[Array, ""]) -> "Forces":
        """The friction of `drive` in the same motion from `z0`, with noise drawn with `key`."""
        error = self.errors(drive, z0).reshape(self.valid.shape) * self.noise[:, None]
        drawn = self.force + error + self.noise[:, None] * jax.random.normal(key, self.force.shape)
        return eqx.tree_at(lambda e: e.force, self, drawn)


def make_forces(recordings: tuple[Recording, ...], known: tuple[float | None, ...] | None = None) -> Forces:
    """Motion-driven `recordings` side by side in `Forces`; their first noise is that of the force's fourth differences,
    or more. `known`: noise of each that is given, or None."""
    rate = float(np.median([r.sample_rate for r in recordings]))
    block = max(round(_BLOCK * rate), 8)
    longest = max(r.x.size for r in recordings)
    padded = -(-longest // block) * block

    def side_by_side(channels: list[Float[np.ndarray, "..."]]) -> Float[Array, "r n"]:
        return jnp.asarray(np.stack([np.pad(c, (0, padded - c.size), mode="edge") for c in channels]))

    forces = [np.asarray(r.force) for r in recordings]
    lengths = np.array([r.x.size for r in recordings])
    noise = [
        max(float(np.std(np.diff(f, 4))) / np.sqrt(70.0), _FIRST_NOISE * float(np.std(f)), 1e-300)
        for f in forces
    ]
    given = [np.nan if level is None else level for level in known or (None,) * len(forces)]
    return Forces(
        x=side_by_side([r.x for r in recordings]),
        force=side_by_side(forces),
        valid=jnp.asarray(np.arange(padded)[None] < lengths[:, None], dtype=float),
        dt=jnp.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=jnp.asarray(noise),
        known=jnp.asarray(given, dtype=float),
        block=block,
        lengths=lengths,
    )
