"""How well a model predicts the recordings it was fitted to, and the held-out ones."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core.arrays import Numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import shares, within
from frictionjax.estimation.data.batch import CLUSTER, AbstractBatch, rows_of
from frictionjax.estimation.descent.robust import RobustFit
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive
from frictionjax.simulation import ObserverGains


class Scene(eqx.Module):
    """All recordings of a case, as the mismatch map and the plots use them.

    **Attributes:** `batch` (fit and held-out recordings), `held_out` (bool, shape `(r,)`), `bandwidth` of the observer
    of each (Hz, shape `(r,)`; 0 where the motion is imposed and there is none), `names` of the recordings, `varying`
    (gains of the observer and unit of its innovations where they vary along a recording; None where none does).
    """

    batch: AbstractBatch
    held_out: Bool[np.ndarray, " r"]
    bandwidth: Float[np.ndarray, " r"]
    names: tuple[str, ...] = eqx.field(static=True)
    varying: "Varying | None" = None

    @property
    def white(self) -> Bool[np.ndarray, " r"]:
        """Whether the innovations of a true model are white in each recording, shape `(r,)`: those of a Kalman filter,
        whose gains vary, and the errors of an imposed motion's force."""
        imposed = np.asarray(self.bandwidth) == 0.0
        return imposed if self.varying is None else imposed | np.asarray(self.varying.varies)

    def of(self, rows: Int[np.ndarray, " k"]) -> "Scene":
        """The recordings `rows` alone."""
        names = tuple(self.names[row] for row in rows)
        own = self.varying and self.varying.of(rows)
        return Scene(rows_of(self.batch, rows), self.held_out[rows], self.bandwidth[rows], names, own)


class Varying(eqx.Module):
    """Gains that vary along a recording.

    **Attributes:** `gains` (shape `(r, n)`), `unit` (standard deviation of the innovations of a perfect model over that
    of the sensor's noise, shape `(r, n)`), `varies` (in which recordings they do, shape `(r,)`).
    """

    gains: ObserverGains
    unit: Float[np.ndarray, "r n"]
    varies: Bool[np.ndarray, " r"]

    def of(self, rows: Int[np.ndarray, " k"], length: int | None = None) -> "Varying":
        """Those of the recordings `rows`, up to `length` samples."""
        return jax.tree.map(
            lambda leaf: np.asarray(leaf)[rows][:, :length] if leaf.ndim > 1 else np.asarray(leaf)[rows], self
        )


class Judgement(PlainMethods, eqx.Module):
    """One model, and the innovations that it leaves in all recordings.

    **Attributes:** `drive`, `vector` (shape `(q,)`; the last `r` are the starting deflections), `power` (mean square of
    the standardised innovations in each block, `(r, b)`), `held_out` (bool, `(r,)`), `batch`.
    """

    drive: Drive
    vector: Float[Numbers, " q"]
    power: Float[np.ndarray, "r b"]
    held_out: Bool[np.ndarray, " r"]
    batch: AbstractBatch

    @property
    def deflection(self) -> Float[np.ndarray, " r"]:
        """Starting deflection of the bristle in each recording over Fs/sigma0, shape `(r,)`."""
        return np.asarray(self.vector)[-self.held_out.size :]

    def misfits(self, floor: Float[np.ndarray, "#r #b"]) -> tuple[float, float]:
        """Robust misfit per sample above the `floor` of each block, shape `(r, b)`: fit and held-out recordings."""
        loss, count = losses_of(self.power, self.batch, floor), np.asarray(self.batch.block_count)
        parts = [
            float(loss[rows].sum() / max(count[rows].sum(), 1.0)) for rows in (~self.held_out, self.held_out)
        ]
        return parts[0], parts[1]

    def misfit_errors(self) -> tuple[float, float]:
        """Standard errors of `misfits` for a perfect model: fit and held-out recordings.

        Near the floor a misfit is (power - 1)/4. The power of n innovations has the variance 2/n. The noise level by
        which they are standardised is estimated from fourth differences: its variance is that of n/2.626 independent
        samples.
        """
        count = np.asarray(self.batch.block_count)
        samples = (float(count[rows].sum()) for rows in (~self.held_out, self.held_out))
        fit, held = (0.25 * float(np.sqrt(2.0 * (1.0 + 2.626) / max(n, 1.0))) for n in samples)
        return fit, held

    def within(
        self, floor: Float[np.ndarray, "#r #b"], most: float, *, rule: Rule = Rule()
    ) -> tuple[bool, bool]:
        """Whether the misfits above the `floor` are below `most` plus what chance adds to them, by the `rule`: fit,
        held-out."""
        return within(self.misfits(floor), self.misfit_errors(), most, rule)

    def clusters(self, floor: Float[np.ndarray, "#r #b"]) -> Float[np.ndarray, "r c"]:
        """Loss of each cluster of 0.5 s, above the `floor`."""
        return by_cluster(losses_of(self.power, self.batch, floor))


def by_cluster(blocks: Float[np.ndarray, "r b"]) -> Float[np.ndarray, "r c"]:
    """Sum over the `blocks` of each cluster of 0.5 s."""
    short = -blocks.shape[1] % CLUSTER
    return np.pad(blocks, ((0, 0), (0, short))).reshape(blocks.shape[0], -1, CLUSTER).sum(-1)


def judge(posterior: Posterior, fitted: RobustFit) -> Judgement:
    """The `Judgement` of the model that a descent of the `posterior` ended at, `fitted`. Held-out recordings determined
    nothing but their own starting deflections."""
    power = np.nan_to_num(fitted.power, nan=1e30, posinf=1e30) * posterior.batch.eased[:, None]
    held_out = np.asarray(posterior.fitted[0]) == 0.0
    return Judgement(posterior.drive_of(fitted.vector), fitted.vector, power, held_out, posterior.batch)


def explained(
    before: Judgement, after: Judgement, floor: Float[np.ndarray, "#r #b"], *, rule: Rule = Rule()
) -> tuple[float, float]:
    """Share of the misfit of `before` above the `floor` that `after` removes, by the `rule`: fit recordings, held-out
    ones."""
    return shares(before.misfits(floor), after.misfits(floor), rule)


def energy_explained(
    before: Judgement, after: Judgement, floor: Float[np.ndarray, "#r #b"], *, rule: Rule = Rule()
) -> tuple[float, float]:
    """Share of the power above the `floor` that `after` removes, on fit and on held-out recordings.

    Powers are capped at a high quantile of `before`, by the `rule`, so that a few impacts do not decide. Far from the
    noise this share is informative where the misfit, a logarithm of the power, hardly changes.
    """
    removed = []
    for rows in (~before.held_out, before.held_out):
        scored = np.asarray(before.batch.block_count)[rows] > 0
        old, new = before.power[rows][scored], after.power[rows][scored]
        noise = np.broadcast_to(floor, before.power.shape)[rows][scored]
        cap = np.quantile(old, rule.floor.energy_quantile) if old.size else 1.0
        excess = np.mean(np.maximum(np.minimum(old, cap) - noise, 0.0)) if old.size else 0.0
        left = np.mean(np.maximum(np.minimum(new, cap) - noise, 0.0)) if old.size else 0.0
        removed.append(float(1.0 - left / excess) if excess > 0 else 0.0)
    return removed[0], removed[1]
