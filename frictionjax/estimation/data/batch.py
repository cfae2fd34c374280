"""Recordings as arrays side by side: padded to one length, with masks, noise levels and initial states."""

import dataclasses
import functools
import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int, PyTree

from frictionjax.core.arrays import Numbers, known
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.estimation.data.pieces import Piece, RunLength, earlier_of, lanes_of, padded
from frictionjax.physics.effects import TEMPERATURES, Before
from frictionjax.recordings import Recording
from frictionjax.simulation import ObserverGains
from frictionjax.simulation.ros2 import Substeps

# The observer forgets its first guess of the velocity within this time, s; nothing before it is scored.
_SETTLING = 0.1
BLOCK = 0.05
"""Length of a block, s: the likelihood counts blocks, so that one break-away cannot outvote all else."""


CLUSTER = 10
"""Blocks in a cluster (0.5 s): longer than the memory of the observer and of most unmodelled forces."""


class AbstractBatch(PlainMethods, eqx.Module):
    """`r` recordings padded to `n` samples (`n` a whole number of blocks), force-driven or of an imposed motion.

    **Attributes:** `x` (position units), `valid` (1 where scored, else 0), shape `(r, n)`; `dt` (s), `noise` (standard
    deviation of the noise of the measured output), shape `(r,)`; `block` (samples per block); `lengths` (samples of
    each recording); `before` (what came before each, arrays of shape `(r,)`, `(r, k)`); `substeps` (integration steps
    a sample); `integrated` (whether the positions are integrated velocities, shape `(r,)`); `run`: of a piece, what is
    then a number of the case.
    """

    x: eqx.AbstractVar[Float[Numbers, "r n"]]
    valid: eqx.AbstractVar[Float[Numbers, "r n"]]
    dt: eqx.AbstractVar[Float[Numbers, " r"]]
    noise: eqx.AbstractVar[Float[Numbers, " r"]]
    block: eqx.AbstractVar[int]
    lengths: eqx.AbstractVar[Int[np.ndarray, " r"]]
    before: eqx.AbstractVar[Before]
    substeps: eqx.AbstractVar[int]
    integrated: eqx.AbstractVar[Bool[Numbers, " r"]]
    run: eqx.AbstractVar[RunLength | None]

    @property
    @abstractmethod
    def imposed(self) -> bool:
        """Whether the motion was imposed, and the friction force is the measured output."""

    @property
    @abstractmethod
    def answer(self) -> Float[Numbers, "r n"]:
        """The measured output, which a model predicts: position or force, shape `(r, n)`."""

    @property
    @abstractmethod
    def inputs(self) -> Float[Numbers, "r n"] | None:
        """The applied input, input units, shape `(r, n)`; None where the motion was imposed."""

    @property
    @abstractmethod
    def position_noise(self) -> Float[Numbers, " r"] | None:
        """Standard deviation of the noise of the measured position, shape `(r,)`; None where the position is given."""

    @abstractmethod
    def with_substeps(self, substeps: int) -> "AbstractBatch":
        """The same recordings with so many integration `substeps` a sample. An imposed motion keeps its own."""

    @abstractmethod
    def piece(self, piece: Piece) -> "AbstractBatch":
        """The recordings of a `piece`, of its shape."""

    @property
    def samples(self) -> Int[Numbers, ""] | None:
        """How many samples are to be run along, in a piece; None: all."""
        return None if self.run is None else self.run.samples

    @property
    def steps(self) -> Substeps:
        """Integration steps a sample."""
        return self.substeps if self.run is None else self.run.substeps

    def block_mean(self, squares: Float[Numbers, "*k r n"]) -> Float[Numbers, "*k r b"]:
        """Mean over the scored samples of each block; 0 for a block without any. Shape `(..., r, n / block)`."""
        xp, (squares, valid) = known(squares, self.valid)
        weight = valid.reshape(valid.shape[0], -1, self.block)
        total = xp.sum(squares.reshape(*squares.shape[:-1], -1, self.block) * weight, axis=-1)
        return total / xp.maximum(xp.sum(weight, axis=-1), 1.0)

    @property
    def eased(self) -> Float[np.ndarray, " r"]:
        """Power of the noise with which errors are standardised over that of the measured noise, shape `(r,)`."""
        return np.ones(self.x.shape[0])

    @property
    def block_count(self) -> Float[Numbers, "r b"]:
        """Scored samples in each block, shape `(r, n / block)`."""
        xp, (valid,) = known(self.valid)
        return xp.sum(valid.reshape(valid.shape[0], -1, self.block), axis=-1)


def rows_of(tree: PyTree, rows: Int[np.ndarray, " k"]) -> PyTree:
    """These `rows` of every array of a `tree`. By NumPy: no shape is compiled for."""

    return jax.tree.map(lambda leaf: np.asarray(leaf)[rows], tree)


class Batch(AbstractBatch):
    """Force-driven recordings: the applied input and the measured position.

    **Attributes:** beside those of every batch `u` (input units), shape `(r, n)`, and position and velocity at the
    first sample, `x0`, `v0`, shape `(r,)`; `noise` is that of the position (`noise_level`); `substeps`: integration
    steps a sample.
    """

    u: Float[Numbers, "r n"]
    x: Float[Numbers, "r n"]
    valid: Float[Numbers, "r n"]
    dt: Float[Numbers, " r"]
    noise: Float[Numbers, " r"]
    x0: Float[Numbers, " r"]
    v0: Float[Numbers, " r"]
    integrated: Bool[Numbers, " r"]
    block: int = eqx.field(static=True)
    lengths: Int[np.ndarray, " r"]
    before: Before
    substeps: int = eqx.field(static=True, default=1)
    run: RunLength | None = None

    def piece(self, piece: Piece) -> "Batch":
        """The recordings of a `piece`, of its shape."""
        return Batch(
            u=padded(self.u, piece),
            x=padded(self.x, piece),
            valid=padded(self.valid, piece, "zero"),
            **lanes_of(
                {name: getattr(self, name) for name in ("dt", "noise", "x0", "v0", "integrated")}, piece
            ),
            block=1,
            lengths=self.lengths[piece.lanes],
            before=before_piece(self.before, piece),
            run=RunLength(np.asarray(piece.samples), np.asarray(self.substeps)),
        )

    @property
    def imposed(self) -> bool:
        """False: an input was applied."""
        return False

    @property
    def answer(self) -> Float[Numbers, "r n"]:
        """The measured position."""
        return self.x

    @property
    def inputs(self) -> Float[Numbers, "r n"]:
        """The applied input, input units."""
        return self.u

    @property
    def position_noise(self) -> Float[Numbers, " r"]:
        """Standard deviation of the noise of the position."""
        return self.noise

    def with_substeps(self, substeps: int) -> "Batch":
        """The same recordings with so many integration `substeps` a sample."""
        return self if substeps == self.substeps else dataclasses.replace(self, substeps=substeps)

    def first(self, samples: int) -> "Batch":
        """The same recordings up to so many `samples`, or a few more: a whole number of blocks."""
        most = -(-samples // self.block) * self.block
        cut = {name: np.asarray(getattr(self, name))[:, :most] for name in ("u", "x", "valid")}
        return dataclasses.replace(self, **cut, lengths=np.minimum(self.lengths, most))

    def each(
        self,
        function: Callable[..., PyTree],
        gains: ObserverGains,
        deflection: Float[Numbers, " r"],
        *more: PyTree,
    ) -> PyTree:
        """`function` of every recording, side by side.

        **Arguments:**

        - `function`: called with the input and the position, shape `(n,)`, the time step (s), the observer's gains, and
          where it starts: `(x, v, z, before)`; then with the rows of `more`.
        - `gains`: of the observer, one per recording, shape `(r,)`, or one per sample, shape `(r, n)`.
        - `deflection`: of the bristle at the first sample, position units, shape `(r,)`.
        - `more`: further arrays of leading size `r`.
        """

        def one(
            u: Float[Numbers, " n"],
            x: Float[Numbers, " n"],
            dt: Float[Numbers, ""],
            gains: ObserverGains,
            x0: Float[Numbers, ""],
            v0: Float[Numbers, ""],
            z0: Float[Numbers, ""],
            before: Before,
            *more: PyTree,
        ) -> PyTree:
            return function(u, x, dt, gains, (x0, v0, z0, before), *more)

        return jax.vmap(one)(self.u, self.x, self.dt, gains, self.x0, self.v0, deflection, self.before, *more)


def before_piece(before: Before, piece: Piece) -> Before:
    """What was `before` the recordings of a `piece`."""
    earlier = {name: earlier_of(getattr(before, name), piece) for name in ("path", "age")}
    rest = lanes_of(
        {name: getattr(before, name) for name in ("clock", "rest", "duration", "temperature")}, piece
    )
    return _before(**earlier, **rest)


def white_level(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of the white noise of `values`, in their unit, from fourth differences.

    `std(diff(values, 4)) / sqrt(70)` is blind to smooth motion; its median over short stretches is blind to impacts.
    """
    differences = np.diff(values, 4)
    stretch = min(max(differences.size // 200, 50), differences.size)
    usable = differences[: differences.size // stretch * stretch].reshape(-1, stretch)
    # Fourth differences of white noise are correlated: a stretch holds stretch / 2.626 free ones, and the median of a
    # chi-square with that many degrees of freedom is a little below its mean (Wilson and Hilferty).
    below = (1.0 - 2.0 / (9.0 * stretch / 2.626)) ** 3
    return float(np.sqrt(np.median(np.mean(usable**2, axis=1)) / 70.0 / below))


def noise_level(recording: Recording, encoder_step: float | None = None) -> float:
    """Standard deviation of the position noise, position units: its `white_level`, but not below what the quantisation
    alone leaves, step / sqrt(12). Of an integrated velocity with white noise s it is s dt / sqrt(2): the noise of the
    integral is a random walk, whose steps have twice that power (`simulation.sensor_noise`)."""
    measured, factor = recording.x, 1.0
    if recording.integrated:
        assert recording.v is not None  # x is its integral
        measured, factor, encoder_step = recording.v, math.sqrt(0.5) / recording.sample_rate, None
    if encoder_step is None:
        jumps = np.abs(np.diff(measured))
        jumps = jumps[jumps > 1e-12 * np.ptp(measured)]
        encoder_step = float(np.min(jumps)) if jumps.size else 0.0
    # The recording of a machine that never moves, by an encoder of unknown step, has neither noise nor a step.
    found = factor * max(white_level(measured), encoder_step / np.sqrt(12.0))
    return found or 1e-9 * float(np.max(np.abs(recording.x))) or _NO_POSITION


_NO_POSITION = 1e-12  # position units: noise of a recording that is zero throughout, in any units


def least_samples(sample_rate: float) -> int:
    """Samples that a recording needs to be scored at all: the observer's settling and two blocks."""
    return round((_SETTLING + 2.0 * BLOCK) * sample_rate)


_LEAST_RATE = 1000.0  # integration steps a second, Hz, or a tenth less
_PIECES = 16  # into which a recording is cut for what came before the others


def what_was_before(recordings: tuple[Recording, ...]) -> Before:
    """What came before each of the `recordings`, by their starting times on one clock: arrays of shape `(r,)`, and
    `(r, k)` for the paths travelled before.

    Recordings that all start at zero share no clock: their history is then unknown.
    """
    starts = np.array([r.start_time for r in recordings])
    ends = starts + np.array([r.duration for r in recordings])
    paths, when = [], []
    for recording in recordings:
        pieces = np.array_split(recording.x, _PIECES)
        paths += [_path(piece) for piece in pieces]
        when += [recording.start_time + recording.duration * (k + 0.5) / _PIECES for k in range(_PIECES)]
    ago = starts[:, None] - np.array(when)[None, :]
    shared = np.unique(starts).size > 1
    earlier = (ago > 0.0) & shared
    rest = [min((s - e for e in ends if e <= s + 1e-9), default=s) if shared else 1.0 for s in starts]
    return _before(
        clock=starts,
        rest=np.maximum(rest, 0.0),
        path=np.where(earlier, np.array(paths)[None, :], 0.0),
        age=np.where(earlier, ago, 0.0),
        duration=np.array([r.duration for r in recordings]),
        temperature=_temperatures(recordings),
    )


def _before(**numbers: Float[np.ndarray, "..."]) -> Before:
    """A `Before` of these arrays as they are: its own converter would compile something for each shape."""
    names = (field.name for field in dataclasses.fields(Before))
    return jax.tree.unflatten(_structure_of_before(), [numbers[name] for name in names])


@functools.cache
def _structure_of_before() -> Any:
    return jax.tree.structure(Before())


def _temperatures(recordings: tuple[Recording, ...]) -> Float[np.ndarray, "r k"]:
    """Measured temperatures as in `Before`, shape `(r, TEMPERATURES)`; zeros unless every recording has them."""
    if any(r.temperature is None for r in recordings):
        return np.zeros((len(recordings), TEMPERATURES))
    first = min(recordings, key=lambda r: r.start_time)
    kept = []
    for recording in recordings:
        pieces = np.array_split(np.asarray(recording.temperature), 4 * (TEMPERATURES - 1))
        means = np.array([piece.mean() for piece in pieces])
        middle = (np.arange(means.size) + 0.5) / means.size
        kept.append(np.interp(np.linspace(0.0, 1.0, TEMPERATURES), middle, means))
    return np.array(kept) - kept[recordings.index(first)][0]


def _path(x: Float[np.ndarray, " n"]) -> float:
    """Length of the path of `x`, position units, from about 200 of its samples."""
    return float(np.sum(np.abs(np.diff(x[:: max(x.size // 200, 1)]))))


def block_of(recordings: tuple[Recording, ...]) -> int:
    """Samples in a block of the `recordings`."""
    return max(round(BLOCK * float(np.median([r.sample_rate for r in recordings]))), 8)


def side_by_side(channels: Sequence[Float[np.ndarray, "..."]], block: int) -> Float[np.ndarray, "r n"]:
    """One channel of each recording, padded to one length, a whole number of blocks of `block` samples.

    Padding repeats the last value: finite, at rest, and to be masked (NaN would poison derivatives). Lengths go by
    sixteenths of an octave: cases of nearly one length share one compiled program, for 2 % more samples in the mean.
    """
    blocks = -(-max(channel.size for channel in channels) // block)
    step = 1 << max(blocks.bit_length() - 5, 0)
    padded = -(-blocks // step) * step * block
    return np.stack([np.pad(channel, (0, padded - channel.size), mode="edge") for channel in channels])


def steps_a_sample(recordings: Sequence[Recording]) -> int:
    """Integration steps a sample that the slowest of the `recordings` needs."""
    return max(math.ceil(_LEAST_RATE / min(r.sample_rate for r in recordings) - 0.1), 1)


def make_batch(recordings: tuple[Recording, ...], *, encoder_step: float | None = None) -> Batch:
    """Put force-driven `recordings` side by side in a `Batch`, with so many integration steps a sample that none is
    much longer than 1 ms: bristles that ring between two samples of a slow recorder are part of the machine, too.

    **Raises:** `ValueError` when one of them is shorter than the observer's settling and two blocks, 0.2 s.
    """
    for recording in recordings:
        if recording.x.size < least_samples(recording.sample_rate):
            raise ValueError(
                f"Recording `{recording.name}` has {recording.x.size} samples; at {recording.sample_rate:g} Hz "
                f"it needs {least_samples(recording.sample_rate)}: leave it out."
            )
    block = block_of(recordings)
    x = side_by_side([r.x for r in recordings], block)
    valid = np.zeros(x.shape)
    x0, v0 = [], []
    for row, recording in enumerate(recordings):
        valid[row, round(_SETTLING * recording.sample_rate) : recording.x.size] = 1.0
        head = recording.x[: max(round(0.01 * recording.sample_rate), 10)]
        slope, level = np.polyfit(np.arange(head.size) / recording.sample_rate, head, 1)
        x0.append(float(level))
        v0.append(float(slope))
    noise = [noise_level(r, encoder_step) for r in recordings]
    # A start at rest is the rule; a slope that the noise explains is no motion.
    rates = [r.sample_rate for r in recordings]
    v0 = [
        v if abs(v) > 10.0 * s * rate / max(round(0.01 * rate), 10) ** 1.5 else 0.0
        for v, s, rate in zip(v0, noise, rates, strict=True)
    ]
    x0 = [
        float(np.mean(r.x[: max(round(0.01 * r.sample_rate), 10)])) if v == 0.0 else x
        for r, x, v in zip(recordings, x0, v0, strict=True)
    ]
    return Batch(
        u=side_by_side([r.u for r in recordings], block),
        x=x,
        valid=valid,
        dt=np.asarray([1.0 / r.sample_rate for r in recordings]),
        noise=np.asarray(noise),
        x0=np.asarray(x0),
        v0=np.asarray(v0),
        integrated=np.array([r.integrated for r in recordings]),
        block=block,
        lengths=np.array([r.x.size for r in recordings]),
        before=what_was_before(recordings),
        substeps=steps_a_sample(recordings),
    )
