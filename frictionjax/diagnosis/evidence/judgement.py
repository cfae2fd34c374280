"""Judge: what a model explains, on the recordings it was fitted to and on those kept aside."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import CLUSTER, AbstractBatch
from frictionjax.estimation.descent.robust import Fitted
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive

ADEQUATE_MISFIT = 0.01
"""Robust misfit per sample, above the floor, below which nothing significant is missing: errors of 4 % more power than
the floor, since a misfit of m is a power of 2 exp(2 m) - 1 times the floor."""
_SURE = 3.0  # standard errors


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

    def within(self, floor: np.ndarray, most: float) -> tuple[bool, bool]:
        """Whether the misfits are below `most` and what chance adds in recordings of this length: fit, held-out."""
        fit, held = (
            misfit < most + _SURE * error
            for misfit, error in zip(self.misfits(floor), self.misfit_errors(), strict=True)
        )
        return fit, held

    def clusters(self, floor: np.ndarray) -> Float[np.ndarray, "r c"]:
        """Loss against the `floor` of each cluster of 0.5 s."""
        loss = losses_of(self.power, self.batch, floor)
        short = -loss.shape[1] % CLUSTER
        return np.pad(loss, ((0, 0), (0, short))).reshape(loss.shape[0], -1, CLUSTER).sum(-1)


def judge(joint: Posterior, fitted: Fitted) -> Judgement:
    """Judge what a descent of `joint` came to; held-out recordings have chosen their starting deflections alone."""
    power = np.nan_to_num(fitted.power, nan=1e30, posinf=1e30) * joint.batch.eased[:, None]
    held_out = np.asarray(joint.fitted[0]) == 0.0
    return Judgement(joint.drive_of(fitted.vector), fitted.vector, power, held_out, joint.batch)


def explained(before: Judgement, after: Judgement, floor: np.ndarray) -> tuple[float, float]:
    """Share of the misfit of `before` above the `floor` that `after` removes: fit recordings, held-out ones.

    Where one set shows what the other hardly does, what the other leaves is counted against what would be adequate: a
    share of a misfit at the floor is chance.
    """
    wholes, news = _wholes(before.misfits(floor)), after.misfits(floor)
    shares = [1.0 - new / whole if whole > 0.0 else 0.0 for whole, new in zip(wholes, news, strict=True)]
    return shares[0], shares[1]


def _wholes(misfits: tuple[float, float]) -> tuple[float, float]:
    """What a share of the `misfits` is a share of."""
    least = ADEQUATE_MISFIT if max(misfits) > ADEQUATE_MISFIT else 0.0
    return max(misfits[0], least), max(misfits[1], least)


def left_over(misfits: tuple[float, float], shares: tuple[float, float]) -> tuple[float, float]:
    """The misfits that are left of `misfits` where these `shares` of them are `explained`: fit, held-out."""
    fit, held = (whole * (1.0 - share) for whole, share in zip(_wholes(misfits), shares, strict=True))
    return fit, held


def energy_explained(before: Judgement, after: Judgement, floor: np.ndarray) -> tuple[float, float]:
    """Share of the power above the `floor` that `after` removes, on fit and on held-out recordings.

    Blocks above the 95 % quantile of `before` count as that quantile: a few impacts must not decide. Where
    nothing is near the noise the logarithm of the likelihood is blind to this share.
    """
    shares = []
    for rows in (~before.held_out, before.held_out):
        scored = np.asarray(before.batch.block_count)[rows] > 0
        old, new = before.power[rows][scored], after.power[rows][scored]
        ground = np.broadcast_to(floor, before.power.shape)[rows][scored]
        cap = np.quantile(old, 0.95) if old.size else 1.0
        excess = np.mean(np.maximum(np.minimum(old, cap) - ground, 0.0)) if old.size else 0.0
        left = np.mean(np.maximum(np.minimum(new, cap) - ground, 0.0)) if old.size else 0.0
        shares.append(float(1.0 - left / excess) if excess > 0 else 0.0)
    return shares[0], shares[1]


def advantage(better: Judgement, other: Judgement, rows: np.ndarray, floor: np.ndarray) -> float:
    """How many standard errors `better` leads `other` by, over the paired clusters of the recordings `rows`."""
    lead = (other.clusters(floor) - better.clusters(floor))[rows].ravel()
    lead = lead[lead != 0.0]
    if lead.size < 4:
        return 0.0
    return float(lead.sum() / (np.sqrt(lead.size) * max(float(lead.std()), 1e-300)))
