"""Force-driven recordings and one model structure, ready to be fitted through the fixed-gain observer."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.least_squares import Setting, errors_of
from frictionjax.estimation.parameters import Free, base_layout, effect_layout, pack, unpack
from frictionjax.estimation.residuals import block_power, mismatch, weights
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect
from frictionjax.simulation import observer_gains

FAST_BANDWIDTH, SLOW_BANDWIDTH = 100.0, 50.0
"""Bandwidth of the observer, Hz: the fast one is short-sighted and forgiving, the slow one sees weaker effects."""

_PRIOR_LOG, _PRIOR_STRENGTH, _PRIOR_DEFLECTION = 3.0, 1e3, 0.5  # standard deviations of the weak prior


def weak_prior(layout: tuple[Free, ...], recordings: int) -> Float[Array, " q"]:
    """Inverse standard deviations of the weak prior for the parameters of `layout` and the starting deflections of
    so many `recordings`, shape `(q,)`."""
    deviation = [_PRIOR_LOG if free.parameter.transform == "log" else _PRIOR_STRENGTH for free in layout]
    return 1.0 / jnp.asarray(deviation + [_PRIOR_DEFLECTION] * recordings)


class Problem(eqx.Module):
    """Recordings and layout of one model structure, ready to be fitted.

    **Attributes:** `layout` (free parameters), `setting` (everything else).
    """

    layout: tuple[Free, ...]
    setting: Setting

    def at_bandwidth(self, bandwidth: float) -> "Problem":
        """The same problem seen by an observer of `bandwidth` Hz."""
        dt = self.setting.batch.dt
        gains = observer_gains(min(bandwidth, 0.1 / float(jnp.max(dt))), dt)
        return Problem(self.layout, eqx.tree_at(lambda s: s.gains, self.setting, gains))

    def weighted(self, power: Float[Array, "r b"], knee: float) -> "Problem":
        """The same problem with the weights of the block powers `power` and the knee `knee` (in noise levels)."""
        weight = weights(power, jnp.asarray(knee), self.setting.batch)
        return eqx.tree_at(lambda p: p.setting.weight, self, weight)

    def errors(self, *vectors: Float[Array, " q"]) -> Float[Array, "k r n"]:
        """Standardised innovations of each of `vectors`, shape `(k, r, n)`."""
        return errors_of(self.layout, list(vectors), self.setting)

    def powers(self, *vectors: Float[Array, " q"]) -> Float[Array, "k r b"]:
        """Block powers of the standardised innovations of each of `vectors`, shape `(k, r, b)`."""
        return _block_powers(self.errors(*vectors), self.setting.batch)

    def misfits(self, *vectors: Float[Array, " q"]) -> Float[np.ndarray, " k"]:
        """Robust misfit per sample of each of `vectors`: 0 when every block is at the noise floor."""
        return misfits_of(self.powers(*vectors), 1.0, self.setting.batch)

    def power(self, vector: Float[Array, " q"]) -> Float[Array, "r b"]:
        """Block powers of the standardised innovations, shape `(r, b)`."""
        return self.powers(vector)[0]

    def mismatch(self, vector: Float[Array, " q"]) -> float:
        """Robust misfit per sample: 0 when every block is at the noise floor."""
        return float(self.misfits(vector)[0])

    def drive(self, vector: Float[Array, " q"]) -> Drive:
        """The `Drive` of a free vector."""
        count = len(self.layout)
        return unpack(self.layout, self.setting.drive, vector[:count], self.setting.start[:count])


@eqx.filter_jit
def _block_powers(e, batch):
    return jax.vmap(lambda lane: block_power(lane, batch))(e)


def misfits_of(powers: Float[Array, "k r b"], floor: float, batch: Batch) -> Float[np.ndarray, " k"]:
    """Robust misfit per sample against `floor` (1: noise); infinite where a trajectory is not finite."""
    values = np.asarray(jax.vmap(lambda power: mismatch(power, jnp.asarray(floor), batch))(powers))
    return np.where(np.isfinite(values), values, np.inf)


def make_problem(
    drive: Drive,
    batch: Batch,
    *,
    scales: dict[str, float] | None = None,
    known_inertia: bool = False,
    bandwidth: float = FAST_BANDWIDTH,
) -> tuple[Problem, Float[Array, " q"]]:
    """The problem of fitting `drive` (base parameters and those of its effects) to `batch`, and its first vector.

    **Arguments:**

    - `drive`: structure and start.
    - `batch`: the recordings.
    - `scales`: the plant's own sizes by name, for the effects' scales.
    - `known_inertia`: keep J.
    - `bandwidth`: of the observer, Hz.
    """
    dt = float(jnp.max(batch.dt))
    layout = base_layout(drive, dt, known_inertia=known_inertia) + effect_layout(drive, scales or {})
    recordings = batch.u.shape[0]
    start = jnp.concatenate([pack(layout, drive), jnp.zeros(recordings)])
    prior = weak_prior(layout, recordings)
    gains = observer_gains(bandwidth, batch.dt)
    problem = Problem(layout, Setting(drive, batch, gains, batch.valid, start, prior))
    return problem.at_bandwidth(bandwidth), start


def extend_problem(
    present: Problem, vector: Float[Array, " q"], effect: AbstractEffect, scales: dict[str, float]
) -> tuple[Problem, Float[Array, " q"], Drive]:
    """The problem of `present` with `effect` added, at the solution `vector`.

    Ranges, prior and observer stay those of `present`, so that the same vector gives the same misfit.

    **Arguments:**

    - `present`: the fitted problem.
    - `vector`: its solution, shape `(q,)`.
    - `effect`: the effect to add, at zero strength.
    - `scales`: the plant's own sizes by name.

    **Returns:**

    The problem, its vector (shape `(q + k,)`: the k parameters of the effect stand before the starting
    deflections), and the drive.
    """
    old = len(present.layout)
    drive = present.drive(vector).with_effects(effect)
    added = effect_layout(drive, scales, first=len(drive.effects) - 1)
    start = pack(added, drive)

    def insert(values, more):
        return jnp.concatenate([values[:old], more, values[old:]])

    setting = present.setting
    setting = Setting(
        drive,
        setting.batch,
        setting.gains,
        setting.weight,
        insert(setting.start, start),
        insert(setting.prior, weak_prior(added, 0)),
    )
    return Problem(present.layout + added, setting), insert(vector, start), drive
