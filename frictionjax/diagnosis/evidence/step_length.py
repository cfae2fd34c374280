"""How many integration steps a sample a machine needs: until the integration error is small against the noise.

One step a sample is enough for most machines. Where bristles yield within a few samples its error is as large as the
noise, and the mismatch is then one of the integration: an effect that smooths it out would be named.
"""

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.posterior import Posterior

MOST = 4
"""Largest factor on the number of steps. The integration is of second order: a sixteenth of the error of one step
remains, less than a hundredth of its power."""


def _differences(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[np.ndarray, "k r b"]:
    """Power in each block of the difference between the innovations and those with four times as many steps: for the
    number of steps of the batch, and for twice that."""
    own = posterior.batch.substeps
    once, twice, finest = (
        posterior.with_substeps(finer * own).errors_at([vector])[0] for finer in (1, MOST // 2, MOST)
    )
    # Where the finest run is not finite either, finer steps do not help.
    finite = np.isfinite(finest)
    changes = [np.subtract(e, finest, out=np.zeros_like(e), where=finite) for e in (once, twice)]
    return block_power(np.stack(changes), posterior.batch)


def steps_needed(posterior: Posterior, vector: Float[Numbers, " q"], *, rule: Rule = Rule()) -> int:
    """Integration steps a sample with which the integration error alone leaves the model of the `posterior` at `vector`
    adequate by the `rule`, on the fitted recordings and on the held-out ones: once, twice or four times those of its
    batch. 1 where the motion is imposed, since its runs choose their own steps.
    """
    batch = posterior.batch
    if batch.imposed:
        return 1
    own, fitted = batch.substeps, np.asarray(posterior.fitted[0]) > 0
    weight = np.asarray(posterior.weights[0]).reshape(batch.block_count.shape)
    count = np.asarray(batch.block_count) * weight
    for finer, power in zip((1, MOST // 2), _differences(posterior, vector), strict=True):
        losses = losses_of(1.0 + np.asarray(power), batch) * weight
        parts = [losses[rows].sum() / max(count[rows].sum(), 1.0) for rows in (fitted, ~fitted)]
        if max(parts) < rule.limits.adequate:
            return finer * own
    return MOST * own


def with_steps(posterior: Posterior, steps: int) -> Posterior:
    """The same `posterior` with this number of integration `steps` a sample; its recordings are of an applied input."""
    return posterior.with_substeps(steps)
