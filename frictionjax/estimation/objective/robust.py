"""The posterior of a diagnosis: all recordings of a case, held-out ones included, under a robust loss."""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.constraints import Constraints
from frictionjax.estimation.data.batch import AbstractBatch
from frictionjax.estimation.data.imposed_batch import ImposedBatch
from frictionjax.estimation.evidence import AbstractRecordings, Imposed, observed
from frictionjax.estimation.objective.loss import Cauchy
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.parameters import base_layout, effect_layout, pack, weak_prior
from frictionjax.physics import Drive
from frictionjax.physics.effects import AbstractEffect

FAST_BANDWIDTH, SLOW_BANDWIDTH = 100.0, 50.0
"""Bandwidth of the observer, Hz: the fast one tolerates a model that is far off, the slow one shows weaker effects.
Each recording may have a slower pace."""


def as_evidence(
    batch: AbstractBatch, bandwidth: float, *, pace: Float[np.ndarray, " r"] | None = None
) -> AbstractRecordings:
    """The recordings of `batch` as evidence: through an observer of `bandwidth` Hz times the `pace` of each where an
    input was applied."""
    if isinstance(batch, ImposedBatch):
        return Imposed(batch)
    return observed(batch, bandwidth, pace=pace)  # type: ignore[arg-type]


def robust_posterior(
    drive: Drive,
    batch: AbstractBatch,
    held_out: Bool[np.ndarray, " r"],
    *,
    scales: dict[str, float] | None = None,
    fixed: frozenset[str] = frozenset(),
    pace: Float[np.ndarray, " r"] | None = None,
) -> tuple[Posterior, Float[Numbers, " q"]]:
    """The posterior of the structure of `drive` on all recordings, by the fast observer, and the vector of `drive`.

    **Arguments:**

    - `drive`: structure and start.
    - `batch`: the recordings; `held_out` (bool, shape `(r,)`): those that determine no parameter.
    - `scales`: the plant's own sizes by name, for the effects' scales.
    - `fixed`: paths of the parameters that stay as they are, such as `J` or `friction.Fc`; J stays in any case where
        all motion is imposed and it does not act.
    - `pace`: of the observer of each recording, shape `(r,)`; None: 1.
    """
    dt, imposed = float(np.max(batch.dt)), batch.imposed
    layout = base_layout(drive, dt / batch.substeps, known_inertia=imposed, imposed=imposed)
    layout += effect_layout(drive, scales or {})
    layout = tuple(free for free in layout if free.path not in fixed)
    recordings = batch.x.shape[0]
    start = np.concatenate([pack(layout, drive), np.zeros(recordings)])
    evidence = as_evidence(batch, FAST_BANDWIDTH, pace=pace)
    posterior = Posterior(
        constraints=Constraints(layout, (), ()),
        drive=drive,
        start=start,
        prior=weak_prior(layout, recordings),
        evidence=(evidence,),
        weights=(np.ones(evidence.count.shape),),
        loss=Cauchy(),
        fitted=(np.where(held_out, 0.0, 1.0),),
        ceilings=(evidence.largest_derivative,),
    )
    return posterior, start


def extend(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    effect: AbstractEffect,
    scales: dict[str, float],
    drive: Drive | None = None,
) -> tuple[Posterior, Float[Numbers, " longer"]]:
    """`posterior` with `effect` added, at the solution `vector`, and the vector of that.

    Ranges, prior and observer stay, so that the same vector gives the same misfit. The parameters of the effect stand
    before the starting deflections.

    **Arguments:**

    - `posterior`, `vector`: the fitted model.
    - `effect`: the effect to add, at zero strength.
    - `scales`: the plant's own sizes by name.
    - `drive`: of the `vector`, where it is at hand.
    """
    old = posterior.parameters
    drive = (posterior.drive_of(vector) if drive is None else drive).with_effects(effect)
    added = effect_layout(drive, scales, first=len(drive.effects) - 1)
    start = pack(added, drive)

    def insert(values: Float[Numbers, " q"], more: Float[Numbers, " p"]) -> Float[Numbers, " longer"]:
        return np.insert(np.asarray(values), old, np.asarray(more))

    extended = Posterior(
        constraints=Constraints(posterior.layout + added, (), ()),
        drive=drive,
        start=insert(posterior.start, start),
        prior=insert(posterior.prior, weak_prior(added, 0)),
        evidence=posterior.evidence,
        weights=posterior.weights,
        loss=posterior.loss,
        fitted=posterior.fitted,
        ceilings=posterior.ceilings,
    )
    return extended, insert(vector, start)


def graduated(posterior: Posterior, scale: float) -> Posterior:
    """`posterior` with the Cauchy loss of the squared `scale`, its blocks weighed so that those far above it count as
    much, against the prior, as with the scale at the noise."""
    own = eqx.tree_at(lambda p: p.loss, posterior, Cauchy(np.asarray(scale, dtype=float)))
    if scale == 1.0:
        return own
    return eqx.tree_at(
        lambda p: p.weights, own, tuple(2.0 / (1.0 + scale) * weight for weight in own.weights)
    )
