"""Friction forces of a machine whose motion is imposed, as on a tribometer."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.estimation.evidence.base import AbstractEvidence
from frictionjax.physics import Drive
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import imposed_friction

_BLOCK = 0.05  # s


class Forces(AbstractEvidence):
    """Recordings of imposed position and measured friction force, padded to one length.

    **Attributes:** `x` (position units), `force`, `valid` (1 where scored), shape `(r, n)`; `dt` (s) and `noise` of
    the force, shape `(r,)`; `block` (samples), `lengths` (samples of each recording), `substeps` per sample.
    """

    x: Float[Array, "r n"]
    force: Float[Array, "r n"]
    valid: Float[Array, "r n"]
    dt: Float[Array, " r"]
    noise: Float[Array, " r"]
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
    def log_deviation(self) -> Float[Array, ""]:
        """Sum of the logarithms of the noise of all scored samples."""
        return jnp.sum(self.valid * jnp.log(self.noise)[:, None])

    def errors(self, drive: Drive, z0: Float[Array, " rows"]) -> Float[Array, "b n"]:
        """Modelled less measured force of `drive` over its noise, shape `(b, n)`; `z0` over Fs/sigma0."""
        deflection = z0 * drive.friction.Fs / drive.friction.sigma0

        def one(x, dt, z):
            return imposed_friction(drive, x, dt, z, substeps=self.substeps)

        raw = jax.vmap(one)(self.x, self.dt, deflection) - self.force
        return (raw / self.noise[:, None] * self.valid).reshape(-1, self.block)

    def with_noise_of(self, drive: Drive, z0: Float[Array, " rows"]) -> "Forces":
        """The same data with the noise that `drive` leaves in each recording, never less than what was there."""
        error = (self.errors(drive, z0).reshape(self.valid.shape) * self.noise[:, None]) ** 2
        spread = jnp.sqrt(jnp.sum(error, axis=1) / jnp.sum(self.valid, axis=1))
        return eqx.tree_at(lambda e: e.noise, self, spread)


def make_forces(recordings: tuple[Recording, ...]) -> Forces:
    """Motion-driven `recordings` side by side in `Forces`; their noise is that of the force's fourth differences."""
    rate = float(np.median([r.sample_rate for r in recordings]))
    block = max(round(_BLOCK * rate), 8)
    longest = max(r.x.size for r in recordings)
    padded = -(-longest // block) * block

    def side_by_side(channels):
        return jnp.asarray(np.stack([np.pad(c, (0, padded - c.size), mode="edge") for c in channels]))

    forces = [np.asarray(r.force) for r in recordings]
    lengths = np.array([r.x.size for r in recordings])
    noise = [
        max(float(np.std(np.diff(f, 4))) / np.sqrt(70.0), 1e-9 * float(np.ptp(f)), 1e-300) for f in forces
    ]
    return Forces(
        x=side_by_side([r.x for r in recordings]),
        force=side_by_side(forces),
        valid=jnp.asarray(np.arange(padded)[None] < lengths[:, None], dtype=float),
        dt=jnp.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=jnp.asarray(noise),
        block=block,
        lengths=lengths,
    )
