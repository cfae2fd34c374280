"""Recordings of an imposed motion side by side: the position is given, the friction force is measured."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from frictionjax.core import InputError
from frictionjax.estimation.data.batch import AbstractBatch, block_of, side_by_side, what_was_before
from frictionjax.estimation.data.force_noise import force_noise_levels
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import run_imposed


class ImposedBatch(AbstractBatch):
    """Recordings of an imposed motion and of the measured friction force.

    **Attributes:** beside those of every batch `force` (force units), shape `(r, n)`; `noise` is that of the force, and
    `ease`, shape `(r,)`, a factor (at least 1) on it with which errors are standardised.
    """

    x: Float[Array, "r n"]
    force: Float[Array, "r n"]
    valid: Float[Array, "r n"]
    dt: Float[Array, " r"]
    noise: Float[Array, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    before: Before
    ease: Float[Array, " r"]
    substeps: int = eqx.field(static=True, default=1)

    @property
    def imposed(self) -> bool:
        """True: the motion is given."""
        return True

    @property
    def answer(self) -> Float[Array, "r n"]:
        """The measured force."""
        return self.force

    @property
    def inputs(self) -> None:
        """None: no input acts on an imposed motion."""
        return None

    @property
    def position_noise(self) -> None:
        """None: the position is taken as it is."""
        return None

    def with_substeps(self, substeps: int) -> "ImposedBatch":
        """The same: runs along an imposed motion choose their own `substeps`."""
        return self

    @property
    def eased(self) -> Float[np.ndarray, " r"]:
        """Square of `ease`, shape `(r,)`."""
        return np.asarray(self.ease) ** 2

    def run(
        self, drive: Drive, z0: Float[Array, " r"]
    ) -> tuple[Float[Array, "r n"], Float[Array, "r n bristles"], Float[Array, "r n"]]:
        """Velocity, deflection of every bristle and friction force of `drive` along the imposed motions; `z0` is the
        deflection at the first sample, position units. Works under jit, vmap and in derivatives."""
        return jax.vmap(lambda x, dt, z, earlier: run_imposed(drive, x, dt, z, earlier=earlier))(
            self.x, self.dt, z0, self.before
        )


def make_imposed_batch(recordings: tuple[Recording, ...]) -> ImposedBatch:
    """Put motion-driven `recordings` side by side in an `ImposedBatch`.

    **Raises:** `InputError` for a recording whose force is constant or not finite, or that does not move.
    """
    for recording in recordings:
        _check(recording)
    block = block_of(recordings)
    forces = [np.asarray(r.force, dtype=float) for r in recordings]
    x, lengths = side_by_side([r.x for r in recordings], block), np.array([r.x.size for r in recordings])
    return ImposedBatch(
        x=jnp.asarray(x),
        force=jnp.asarray(side_by_side(forces, block)),
        valid=jnp.asarray(np.arange(x.shape[1])[None] < lengths[:, None], dtype=float),
        dt=jnp.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=jnp.asarray(force_noise_levels(recordings)),
        block=block,
        lengths=lengths,
        before=what_was_before(recordings),
        ease=jnp.ones(len(recordings)),
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
