"""Recordings of an imposed motion side by side: the position is given, the friction force is measured."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core import InputError
from frictionjax.core.arrays import Numbers
from frictionjax.estimation.data.batch import (
    AbstractBatch,
    before_piece,
    block_of,
    side_by_side,
    what_was_before,
)
from frictionjax.estimation.data.force_noise import force_noise_levels
from frictionjax.estimation.data.pieces import Piece, RunLength, lanes_of, padded
from frictionjax.physics import Drive
from frictionjax.physics.effects import Before
from frictionjax.recordings import Recording
from frictionjax.simulation.imposed import run_imposed


class ImposedBatch(AbstractBatch):
    """Recordings of an imposed motion and of the measured friction force.

    **Attributes:** beside those of every batch `force` (force units), shape `(r, n)`; `noise` is that of the force, and
    `ease`, shape `(r,)`, a factor (at least 1) on it with which errors are standardised.
    """

    x: Float[Numbers, "r n"]
    force: Float[Numbers, "r n"]
    valid: Float[Numbers, "r n"]
    dt: Float[Numbers, " r"]
    noise: Float[Numbers, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    before: Before
    ease: Float[Numbers, " r"]
    integrated: Bool[Numbers, " r"]
    substeps: int = eqx.field(static=True, default=1)
    run: RunLength | None = None

    def piece(self, piece: Piece) -> "ImposedBatch":
        """The recordings of a `piece`, of its shape; their motion goes on with its last velocity."""
        return ImposedBatch(
            x=padded(self.x, piece, "line"),
            force=padded(self.force, piece),
            valid=padded(self.valid, piece, "zero"),
            **lanes_of({name: getattr(self, name) for name in ("dt", "noise", "ease", "integrated")}, piece),
            block=1,
            lengths=self.lengths[piece.lanes],
            before=before_piece(self.before, piece),
            run=RunLength(np.asarray(piece.samples), np.asarray(self.substeps)),
        )

    @property
    def imposed(self) -> bool:
        """True: the motion is given."""
        return True

    @property
    def answer(self) -> Float[Numbers, "r n"]:
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

    def along(
        self, drive: Drive, z0: Float[Numbers, " r"]
    ) -> tuple[Float[Numbers, "r n"], Float[Numbers, "r n bristles"], Float[Numbers, "r n"]]:
        """Velocity, deflection of every bristle and friction force of `drive` along the imposed motions; `z0` is the
        deflection at the first sample, position units. Works under jit, vmap and in derivatives."""

        def one(
            x: Float[Numbers, " n"], dt: Float[Numbers, ""], z: Float[Numbers, ""], earlier: Before
        ) -> tuple[Float[Numbers, " n"], Float[Numbers, "n bristles"], Float[Numbers, " n"]]:
            return run_imposed(drive, x, dt, z, earlier=earlier, samples=self.samples)

        return jax.vmap(one)(self.x, self.dt, z0, self.before)


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
        x=x,
        force=side_by_side(forces, block),
        valid=np.asarray(np.arange(x.shape[1])[None] < lengths[:, None], dtype=float),
        dt=np.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=np.asarray(force_noise_levels(recordings)),
        block=block,
        lengths=lengths,
        before=what_was_before(recordings),
        ease=np.ones(len(recordings)),
        integrated=np.zeros(len(recordings), dtype=bool),
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
