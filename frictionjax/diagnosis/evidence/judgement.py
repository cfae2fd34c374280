"""Judge: what a model explains, on the recordings it was fitted to and on those kept aside."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.rule import Rule
from frictionjax.diagnosis.table import Lead, shares, whole_misfits, within
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.descent.robust import Fitted
from frictionjax.estimation.objective.joint import Joint, losses_of
from frictionjax.estimation.objective.look import CLUSTER_BLOCKS
from frictionjax.physics import Drive


class Scene(eqx.Module):
    """All recordings of a case, as maps and pictures see them.

    **Attributes:** `batch` (fit and held-out recordings), `held_out` (bool, shape `(r,)`), `bandwidth` of the
    observer (Hz), `names` of the recordings.
    """

    batch: AbstractBatch
    held_out: np.ndarray
    bandwidth: float = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)


class Judgement(eqx.Module):
    """One model before all recordings.

    **Attributes:** `drive`, `vector` (shape `(q,)`; the last `r` are the starting deflections), `power` (mean square of
    the standardised innovations in each block, `(r, b)`), `held_out` (bool, `(r,)`), `batch`.
    """

    drive: Drive
    vector: Float[Array, " q"]
    power: np.ndarray
    held_out: np.ndarray
    batch: AbstractBatch

    @property
    def deflection(self) -> np.ndarray:
        """Starting deflection of the bristle in each recording over Fs/sigma0, shape `(r,)`."""
        return np.asarray(self.vector)[-self.held_out.size :]

    def misfits(self, floor: np.ndarray) -> tuple[float, float]:
        """Robust misfit per sample against the `floor` of each block, shape `(r, b)`: fit and held-out recordings."""
        loss, count = losses_of(self.power, self.batch, floor), np.asarray(self.batch.block_count)
        parts = [
            float(loss[rows].sum() / max(count[rows].sum(), 1.0)) for rows in (~self.held_out, self.held_out)
        ]
        return parts[0], parts[1]

    def misfit_errors(self) -> tuple[float, float]:
        """Standard errors of `misfits` for a perfect model: fit and held-out recordings.

        Near the floor a misfit is (power - 1)/4. The power of n innovations has the variance 2/n, and the noise that
        they are measured in, from fourth differences, that of n/2.626 free ones.
        """
        count = np.asarray(self.batch.block_count)
        samples = (float(count[rows].sum()) for rows in (~self.held_out, self.held_out))
        fit, held = (0.25 * float(np.sqrt(2.0 * (1.0 + 2.626) / max(n, 1.0))) for n in samples)
        return fit, held

    def within(self, floor: np.ndarray, most: float, *, rule: Rule = Rule()) -> tuple[bool, bool]:
        """Whether the misfits are below `most` and what chance adds in recordings of this length: fit, held-out."""
        return within(self.misfits(floor), self.misfit_errors(), most, rule)

    def clusters(self, floor: np.ndarray) -> Float[np.ndarray, "r c"]:
        """Loss against the `floor` of each cluster of 0.5 s."""
        return by_cluster(losses_of(self.power, self.batch, floor))


def by_cluster(blocks: np.ndarray) -> Float[np.ndarray, "r c"]:
    """Sum over the `blocks` of each cluster of 0.5 s."""
    short = -blocks.shape[1] % CLUSTER_BLOCKS
    return np.pad(blocks, ((0, 0), (0, short))).reshape(blocks.shape[0], -1, CLUSTER_BLOCKS).sum(-1)


def judge(joint: Joint, fitted: Fitted) -> Judgement:
    """Judge what a descent of `joint` came to; only starting deflections have seen the recordings kept aside."""
    power = np.nan_to_num(np.asarray(fitted.look.power), nan=1e30, posinf=1e30) * joint.batch.eased[:, None]
    held_out = np.asarray(joint.fitted) == 0.0
    return Judgement(joint.drive(fitted.vector), fitted.vector, power, held_out, joint.batch)


def explained(
    before: Judgement, after: Judgement, floor: np.ndarray, *, rule: Rule = Rule()
) -> tuple[float, float]:
    """Share of the misfit of `before` above the `floor` that `after` removes: fit recordings, held-out ones."""
    return shares(before.misfits(floor), after.misfits(floor), rule)


def left_over(
    misfits: tuple[float, float], explained: tuple[float, float], *, rule: Rule = Rule()
) -> tuple[float, float]:
    """The misfits that are left of `misfits` where these shares of them are `explained`: fit, held-out."""
    wholes = whole_misfits(misfits, rule)
    fit, held = (whole * (1.0 - share) for whole, share in zip(wholes, explained, strict=True))
    return fit, held


def energy_explained(
    before: Judgement, after: Judgement, floor: np.ndarray, *, rule: Rule = Rule()
) -> tuple[float, float]:
    """Share of the power above the `floor` that `after` removes, on fit and on held-out recordings.

    Blocks above a high quantile of `before` count as that quantile: a few impacts must not decide. Where
    nothing is near the noise the logarithm of the likelihood is blind to this share.
    """
    shares = []
    for rows in (~before.held_out, before.held_out):
        scored = np.asarray(before.batch.block_count)[rows] > 0
        old, new = before.power[rows][scored], after.power[rows][scored]
        ground = np.broadcast_to(floor, before.power.shape)[rows][scored]
        cap = np.quantile(old, rule.floor.energy_quantile) if old.size else 1.0
        excess = np.mean(np.maximum(np.minimum(old, cap) - ground, 0.0)) if old.size else 0.0
        left = np.mean(np.maximum(np.minimum(new, cap) - ground, 0.0)) if old.size else 0.0
        shares.append(float(1.0 - left / excess) if excess > 0 else 0.0)
    return shares[0], shares[1]


def advantage(
    better: Judgement, other: Judgement, rows: np.ndarray, floor: np.ndarray, *, rule: Rule = Rule()
) -> float:
    """How many standard errors `better` leads `other` by, over the paired clusters of the recordings `rows`."""
    return paired_lead((other.clusters(floor) - better.clusters(floor))[rows]).in_errors(rule)


def paired_lead(gains: np.ndarray) -> Lead:
    """The lead that these `gains` of paired clusters make, any shape; clusters that do not differ do not count."""
    own = gains[gains != 0.0]
    if own.size == 0:
        return Lead(0.0, 0.0, 0)
    error = float(np.sqrt(own.size)) * max(float(own.std()), 1e-300)
    return Lead(float(own.sum()), error, int(own.size))
