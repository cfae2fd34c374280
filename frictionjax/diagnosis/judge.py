"""Judge: what a model explains, on the recordings it was fitted to and on those kept aside."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.deflection import fit_deflections
from frictionjax.estimation.problem import SLOW_BANDWIDTH
from frictionjax.estimation.residuals import block_power
from frictionjax.estimation.uncertainty import CLUSTER_BLOCKS
from frictionjax.physics import Drive
from frictionjax.simulation import observer_gains


class Scene(eqx.Module):
    """All recordings of a case, as the judgement sees them.

    **Attributes:** `batch` (fit and held-out recordings), `held_out` (bool, shape `(r,)`), `bandwidth` of the
    observer (Hz), `names` of the recordings.
    """

    batch: Batch
    held_out: np.ndarray
    bandwidth: float = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)


def make_scene(batch: Batch, held_out: np.ndarray, names: tuple[str, ...]) -> Scene:
    """The scene of `batch`: its recordings have `names`; `held_out` (bool, shape `(r,)`) tells which are held out."""
    dt = float(np.max(np.asarray(batch.dt)))
    return Scene(batch, held_out, min(SLOW_BANDWIDTH, 0.1 / dt), names)


class Judgement(eqx.Module):
    """One model before all recordings.

    **Attributes:** `drive`, `deflection` (starting deflections, shape `(r,)`), `e` (standardised innovations,
    `(r, n)`), `power` (of each block, `(r, b)`), `loss` (log-likelihood loss of each cluster of 0.5 s, `(r, c)`),
    `misfit_fit` and `misfit_holdout` (robust misfit per sample; 0 is noise), `structure` (the larger of both, against a
    floor that a little process noise may have raised evenly through a recording: what is left is structure).
    """

    drive: Drive
    deflection: np.ndarray
    e: np.ndarray
    power: np.ndarray
    loss: Float[np.ndarray, "r c"]
    misfit_fit: float
    misfit_holdout: float
    structure: float


# Small unmeasured forces raise every block of a recording alike: up to this factor the median block is taken as floor.
_EVENLY_RAISED = 1.35


def judge(drive: Drive, scene: Scene) -> Judgement:
    """Judge `drive` on every recording of the `scene`; only starting deflections are adapted."""
    batch = scene.batch
    gains = observer_gains(scene.bandwidth, batch.dt)
    deflection, e = fit_deflections(drive, batch, gains)
    power = np.nan_to_num(np.asarray(block_power(e, batch)), nan=1e30, posinf=1e30)
    count = np.asarray(batch.block_count)
    loss = 0.5 * count * np.log((power + 1.0) / 2.0)

    def misfit(values: np.ndarray, rows: np.ndarray) -> float:
        return float(values[rows].sum() / count[rows].sum()) if np.any(rows) else 0.0

    middle = np.array([np.median(p[c > 0]) for p, c in zip(power, count, strict=True)])
    raised = np.clip(middle, 1.0, _EVENLY_RAISED)[:, None]
    uneven = 0.5 * count * np.log((power + raised) / (2.0 * raised))
    short = -loss.shape[1] % CLUSTER_BLOCKS
    clusters = np.pad(loss, ((0, 0), (0, short))).reshape(loss.shape[0], -1, CLUSTER_BLOCKS).sum(-1)
    return Judgement(
        drive,
        np.asarray(deflection),
        np.asarray(e),
        power,
        clusters,
        misfit(loss, ~scene.held_out),
        misfit(loss, scene.held_out),
        max(misfit(uneven, ~scene.held_out), misfit(uneven, scene.held_out)),
    )


def explained(before: Judgement, after: Judgement) -> tuple[float, float]:
    """Share of the misfit of `before` that `after` removes: on fit recordings and on held-out ones."""

    def share(old: float, new: float) -> float:
        return 1.0 - new / old if old > 0.0 else 0.0

    return share(before.misfit_fit, after.misfit_fit), share(before.misfit_holdout, after.misfit_holdout)


def energy_explained(before: Judgement, after: Judgement, scene: Scene) -> tuple[float, float]:
    """Share of the excess power that `after` removes, on fit and on held-out recordings.

    Blocks above the 95 % quantile of `before` count as that quantile: a few impacts must not decide. Where
    nothing is near the noise floor the logarithm of the likelihood is blind to this share.
    """
    shares = []
    for rows in (~scene.held_out, scene.held_out):
        scored = np.asarray(scene.batch.block_count)[rows] > 0
        old, new = before.power[rows][scored], after.power[rows][scored]
        cap = np.quantile(old, 0.95)
        excess = np.mean(np.minimum(old, cap)) - 1.0
        shares.append(float(1.0 - (np.mean(np.minimum(new, cap)) - 1.0) / excess) if excess > 0 else 0.0)
    return shares[0], shares[1]


def advantage(better: Judgement, other: Judgement, rows: np.ndarray) -> float:
    """How many standard errors `better` leads `other` by, over the paired clusters of the recordings `rows`."""
    lead = (other.loss - better.loss)[rows].ravel()
    lead = lead[lead != 0.0]
    if lead.size < 4:
        return 0.0
    return float(lead.sum() / (np.sqrt(lead.size) * max(float(lead.std()), 1e-300)))
