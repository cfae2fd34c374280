"""Recordings of imposed motion side by side: the position is given, the friction force answers."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.core import InputError
from frictionjax.estimation.batch import (
    AbstractBatch,
    block_of,
    noise_level,
    side_by_side,
    what_was_before,
    white_level,
)
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import run_imposed

# Of the force's standard deviation: no load cell is straighter and freer of hysteresis than this (0.05 to 0.2 % are
# sold), and many are filtered until their own noise is far below it.
_LEAST_NOISE = 2e-3
_STILL = 4.0  # standard deviations of the position's noise: a block that moves no further stands still
_FEWEST_STILL = 20  # blocks


class ImposedBatch(AbstractBatch):
    """Recordings of an imposed motion and of the friction force that answers.

    **Attributes:** beside those of every batch `force` (force units), shape `(r, n)`; `noise` is that of the force.
    """

    x: Float[Array, "r n"]
    force: Float[Array, "r n"]
    valid: Float[Array, "r n"]
    dt: Float[Array, " r"]
    noise: Float[Array, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    before: Before

    def run(
        self, drive: Drive, z0: Float[Array, " r"]
    ) -> tuple[Float[Array, "r n"], Float[Array, "r n bristles"], Float[Array, "r n"]]:
        """Velocity, deflection of every bristle and friction force of `drive` along the imposed motions; `z0` is the
        deflection at the first sample, position units. Works under jit, vmap and in derivatives."""
        return jax.vmap(lambda x, dt, z, earlier: run_imposed(drive, x, dt, z, earlier=earlier))(
            self.x, self.dt, z0, self.before
        )


def force_noise_level(recording: Recording) -> float:
    """Standard deviation of the noise of a measured force, force units.

    The larger of two. Fourth differences are blind to all smooth change, and so to much of the noise of a sensor that
    is filtered. Blocks in which the machine stands still show that too: nothing else changes a friction force there
    but a drift, which is taken off.
    """
    force, block = np.asarray(recording.force, dtype=float), block_of((recording,))
    count = force.size // block
    blocks = np.arange(count * block).reshape(count, block)
    still = np.ptp(recording.x[blocks], axis=1) <= _STILL * noise_level(recording)
    if np.sum(still) < _FEWEST_STILL:
        return white_level(force)
    t = np.arange(block) - 0.5 * (block - 1)
    rested = force[blocks[still]] - np.mean(force[blocks[still]], axis=1, keepdims=True)
    rested -= np.outer(rested @ t / (t @ t), t)
    return max(white_level(force), float(np.sqrt(np.median(np.sum(rested**2, axis=1) / (block - 2)))))


def make_imposed_batch(recordings: tuple[Recording, ...]) -> ImposedBatch:
    """Put motion-driven `recordings` side by side in an `ImposedBatch`.

    **Raises:** `InputError` for a recording whose force is constant or not finite, or that does not move.
    """
    for recording in recordings:
        _check(recording)
    block = block_of(recordings)
    forces = [np.asarray(r.force, dtype=float) for r in recordings]
    x, lengths = side_by_side([r.x for r in recordings], block), np.array([r.x.size for r in recordings])
    # One machine and one sensor: a recording in which little force occurs has no finer sensor.
    least = _LEAST_NOISE * float(np.std(np.concatenate(forces)))
    return ImposedBatch(
        x=jnp.asarray(x),
        force=jnp.asarray(side_by_side(forces, block)),
        valid=jnp.asarray(np.arange(x.shape[1])[None] < lengths[:, None], dtype=float),
        dt=jnp.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=jnp.asarray([max(force_noise_level(r), least) for r in recordings]),
        block=block,
        lengths=lengths,
        before=what_was_before(recordings),
    )


def _check(recording: Recording) -> None:
    force = recording.force
    if force is None or not np.all(np.isfinite(force)) or not np.ptp(force) > 0.0:
        raise InputError(
            "no friction force that varies was measured",
            place=f"recording {recording.name}",
            cure='check which column is `force`, or set drive = "force" if `u` was applied',
        )
    if not np.ptp(recording.x) > 0.0:
        raise InputError(
            "the imposed position does not move",
            place=f"recording {recording.name}",
            cure="leave it out: without motion there is nothing to identify",
        )
