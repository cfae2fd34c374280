"""All recordings of a case before one model structure: what the diagnosis fits, tests and judges with.

Recordings kept aside ride along: their prediction errors and starting deflections are computed in the same compiled
call, and no parameter sees them.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import AbstractBatch, Batch, rows_of
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.data.no_model import innovations_without_model
from frictionjax.estimation.evidence.residuals import lane_powers, standardised_lanes
from frictionjax.estimation.objective.look import Look, Seen, cluster_curvatures, look_of, seen_at
from frictionjax.estimation.objective.setting import Setting, drives_at
from frictionjax.estimation.parameters import Free, base_layout, effect_layout, pack, unpack, weak_prior
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect
from frictionjax.simulation import Gains, observer_gains

FAST_BANDWIDTH, SLOW_BANDWIDTH = 100.0, 50.0
"""Bandwidth of the observer, Hz: the fast one is short-sighted and forgiving, the slow one sees weaker effects."""
_EXPLODED = 30.0
"""Times what the observer errs without any model: the most by which one coordinate of the model, a factor e of a
parameter, may change an innovation, if its derivative is to mean anything."""
LANES = 6
"""Vectors that are simulated side by side. One number everywhere, so that each layout is compiled once."""


@eqx.filter_jit
def _lanes(layout, vectors, setting: Setting):
    drives, count = drives_at(layout, vectors, setting), len(layout)
    return standardised_lanes(drives, vectors[:, count:], setting.batch, setting.gains)


def _most(batch: AbstractBatch, gains: Gains) -> Float[Array, " r"]:
    """The most that a derivative may be in each recording. An imposed motion is what it is, whatever the model."""
    if not isinstance(batch, Batch):
        return jnp.full(batch.dt.shape, jnp.inf)
    return jnp.asarray(_EXPLODED * np.max(np.abs(innovations_without_model(batch, gains)), axis=1))


class Joint(eqx.Module):
    """One model structure and all recordings.

    **Attributes:** `layout` (free parameters), `setting` (everything else), `fitted` (1 for the recordings that
    parameters see, 0 for those kept aside, shape `(r,)`), `most` (beyond which a derivative of the standardised
    innovations has exploded, shape `(r,)`).
    """

    layout: tuple[Free, ...]
    setting: Setting
    fitted: Float[Array, " r"]
    most: Float[Array, " r"]

    @property
    def batch(self) -> AbstractBatch:
        """The recordings."""
        return self.setting.batch

    def at_bandwidth(self, bandwidth: float) -> "Joint":
        """The same, seen by an observer of `bandwidth` Hz."""
        dt = self.batch.dt
        gains = observer_gains(jnp.minimum(bandwidth, 0.1 / dt), dt)
        return eqx.tree_at(
            lambda joint: (joint.setting.gains, joint.most), self, (gains, _most(self.batch, gains))
        )

    def look(self, vector: Float[Array, " q"], knee: float = 1.0) -> Look:
        """The cost near `vector`, shape `(q,)`, with the Cauchy knee at the power `knee`."""
        return self.look_of(self.seen(vector), vector, knee)

    def look_of(self, seen: Seen, vector: Float[Array, " q"], knee: float = 1.0) -> Look:
        """The same of what is `seen` of the `vector`."""
        return look_of(seen, vector, self.setting, self.fitted, knee)

    def seen(self, vector: Float[Array, " q"]) -> Seen:
        """Standardised innovations at `vector`, shape `(q,)`, and their derivatives."""
        return seen_at(self.layout, vector, self.setting, self.most)

    def curvatures(self, seen: Seen) -> Float[np.ndarray, "c q q"]:
        """The part that each cluster of 0.5 s has in the Hessian of `look_of` what is `seen`; without the prior, which
        is nobody's, they add up to it."""
        own = cluster_curvatures(seen, self.setting.weight, self.fitted, self.batch.block)
        own = np.asarray(own)
        count, (recordings, each) = len(self.layout), own.shape[:2]
        whole = np.zeros((recordings, each, count + recordings, count + recordings))
        for row in range(recordings):
            places = np.append(np.arange(count), count + row)
            whole[row][:, places[:, None], places] = own[row]
        return whole.reshape(-1, *whole.shape[2:])

    def of_fitted(self, vector: Float[Array, " q"]) -> tuple["Joint", Float[Array, " q"]]:
        """The fitted recordings alone, and what is left of `vector`."""
        rows = np.flatnonzero(np.asarray(self.fitted) > 0)
        count, setting = len(self.layout), self.setting
        kept = np.concatenate([np.arange(count), count + rows])
        batch, gains, weight, fitted, most = rows_of(
            (setting.batch, setting.gains, setting.weight, self.fitted, self.most), rows
        )
        start, prior, vector = rows_of((setting.start, setting.prior, jnp.asarray(vector)), kept)
        setting = Setting(setting.drive, batch, gains, weight, start, prior)
        return Joint(self.layout, setting, fitted, most), vector

    def errors(self, vectors: Sequence[Float[Array, " q"]]) -> Float[Array, "k r n"]:
        """Standardised innovations of each of `vectors`, shape `(k, r, n)`, some at a time."""
        found = []
        for first in range(0, len(vectors), LANES):
            some = list(vectors[first : first + LANES])
            padded = some + [some[-1]] * (LANES - len(some))
            stack = jnp.stack([jnp.asarray(v) for v in padded])
            found.append(_lanes(self.layout, stack, self.setting)[: len(some)])
        return jnp.concatenate(found)

    def powers(self, vectors: Sequence[Float[Array, " q"]]) -> Float[np.ndarray, "k r b"]:
        """Block powers of the standardised innovations of each of `vectors`, shape `(k, r, b)`."""
        return np.asarray(lane_powers(self.errors(vectors), self.batch))

    def misfits(self, vectors: Sequence[Float[Array, " q"]]) -> Float[np.ndarray, " k"]:
        """Robust misfit per sample of the fitted recordings for each of `vectors`: 0 when every block is at the noise;
        infinite where a trajectory is not finite."""
        return np.array(
            [misfit_of(power, np.asarray(self.fitted), self.batch) for power in self.powers(vectors)]
        )

    def drive(self, vector: Float[Array, " q"]) -> Drive:
        """The `Drive` of a free vector."""
        count = len(self.layout)
        return unpack(self.layout, self.setting.drive, vector[:count], self.setting.start[:count])


def losses_of(
    power: Float[np.ndarray, "r b"], batch: AbstractBatch, floor: float | np.ndarray = 1.0
) -> np.ndarray:
    """Log-likelihood loss of each block against the power `floor`, shape `(r, b)`; large where not finite."""
    power = np.nan_to_num(np.asarray(power), nan=1e30, posinf=1e30)
    return 0.5 * np.asarray(batch.block_count) * np.log((power + floor) / (2.0 * floor))


def misfit_of(
    power: Float[np.ndarray, "r b"], rows: np.ndarray, batch: AbstractBatch, knee: float = 1.0
) -> float:
    """Robust misfit per sample of the recordings `rows` (weights, shape `(r,)`) with the Cauchy knee at the power
    `knee`; infinite where a trajectory is not finite."""
    if not np.all(np.isfinite(power)):
        return float("inf")
    samples = float(np.sum(np.asarray(batch.block_count) * rows[:, None]))
    return float(np.sum(losses_of(power, batch, knee) * rows[:, None])) / max(samples, 1.0)


def make_joint(
    drive: Drive,
    batch: AbstractBatch,
    held_out: np.ndarray,
    *,
    scales: dict[str, float] | None = None,
    known_inertia: bool = False,
) -> tuple[Joint, Float[Array, " q"]]:
    """All recordings before the structure of `drive`, seen by the fast observer, and the vector of `drive`.

    **Arguments:**

    - `drive`: structure and start.
    - `batch`: the recordings; `held_out` (bool, shape `(r,)`) tells which are kept aside.
    - `scales`: the plant's own sizes by name, for the effects' scales.
    - `known_inertia`: keep J; where all motion is imposed it does not act, and is kept in any case.
    """
    dt, imposed = float(jnp.max(batch.dt)), isinstance(batch, ImposedBatch)
    layout = base_layout(drive, dt / batch.substeps, known_inertia=known_inertia or imposed, imposed=imposed)
    layout += effect_layout(drive, scales or {})
    recordings = batch.x.shape[0]
    start = jnp.asarray(np.concatenate([pack(layout, drive), np.zeros(recordings)]))
    prior = weak_prior(layout, recordings)
    setting = Setting(drive, batch, observer_gains(FAST_BANDWIDTH, batch.dt), batch.valid, start, prior)
    fitted = jnp.asarray(np.where(held_out, 0.0, 1.0))
    return Joint(layout, setting, fitted, 0.0 * fitted).at_bandwidth(FAST_BANDWIDTH), start


def extend(
    joint: Joint,
    vector: Float[Array, " q"],
    effect: AbstractEffect,
    scales: dict[str, float],
    drive: Drive | None = None,
) -> tuple[Joint, Float[Array, " q"]]:
    """`joint` with `effect` added, at the solution `vector`, and the vector of that.

    Ranges, prior and observer stay, so that the same vector gives the same misfit. The parameters of the effect stand
    before the starting deflections.

    **Arguments:**

    - `joint`, `vector`: the fitted model.
    - `effect`: the effect to add, at zero strength.
    - `scales`: the plant's own sizes by name.
    - `drive`: of the `vector`, where it is at hand.
    """
    old = len(joint.layout)
    drive = (joint.drive(vector) if drive is None else drive).with_effects(effect)
    added = effect_layout(drive, scales, first=len(drive.effects) - 1)
    start = pack(added, drive)

    def insert(values, more):
        return jnp.asarray(np.insert(np.asarray(values), old, np.asarray(more)))

    setting = joint.setting
    setting = Setting(
        drive,
        setting.batch,
        setting.gains,
        setting.weight,
        insert(setting.start, start),
        insert(setting.prior, weak_prior(added, 0)),
    )
    return Joint(joint.layout + added, setting, joint.fitted, joint.most), insert(vector, start)
