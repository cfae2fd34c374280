"""How many integration steps a sample a machine needs: as many as it takes for the scheme to pass for noise.

One step a sample is enough for most machines. Where bristles yield within a few samples its error is as large as the
noise, and a fit that finds a mismatch there has found that of the scheme: an effect that smooths it out would be named.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.evidence.judgement import ADEQUATE_MISFIT
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.misfit import losses_of
from frictionjax.estimation.objective.posterior import Posterior

MOST = 4
"""The scheme is of second order: a sixteenth of the error of one step is left, of its power less than a hundredth."""


@eqx.filter_jit
def _differences(joint: Posterior, vector: Float[Array, " q"]) -> Float[Array, "k r b"]:
    """Power in each block of what the innovations have more than those with four times the steps: with as many as the
    batch has, and with twice as many."""
    drive, deflections = joint.drive_of(vector), vector[joint.parameters :]

    def errors(finer: int) -> Float[Array, "r n"]:
        return joint.recordings.standardised(drive, deflections, finer=finer)

    best = errors(MOST)
    # Where the finest run is no number either, finer steps do not help.
    sound = jnp.isfinite(best)
    powers = [
        block_power(jnp.where(sound, errors(finer) - best, 0.0), joint.batch) for finer in (1, MOST // 2)
    ]
    return jnp.stack(powers)


def steps_needed(joint: Posterior, vector: Float[Array, " q"]) -> int:
    """Integration steps a sample with which the model at `vector` would not be thought inadequate for the error of the
    integration alone, on the fitted recordings and on the held-out ones: once, twice or four times those of its batch.
    Where the motion is imposed, 1: its runs keep their own steps.
    """
    batch = joint.batch
    if batch.imposed:
        return 1
    own, fitted = batch.substeps, np.asarray(joint.fitted[0]) > 0
    weight = np.asarray(joint.weights[0]).reshape(batch.block_count.shape)
    count = np.asarray(batch.block_count) * weight
    for finer, power in zip((1, MOST // 2), _differences(joint, vector), strict=True):
        losses = losses_of(1.0 + np.asarray(power), batch) * weight
        parts = [losses[rows].sum() / max(count[rows].sum(), 1.0) for rows in (fitted, ~fitted)]
        if max(parts) < ADEQUATE_MISFIT:
            return finer * own
    return MOST * own


def with_steps(joint: Posterior, steps: int) -> Posterior:
    """The same with so many integration steps a sample, of recordings of an applied input."""
    return eqx.tree_at(lambda own: own.evidence[0].batch, joint, joint.batch.with_substeps(steps))
