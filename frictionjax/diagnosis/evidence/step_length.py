"""How many integration steps a sample a machine needs: as many as it takes for the scheme to pass for noise.

One step a sample is enough for most machines. Where bristles yield within a few samples its error is as large as the
noise, and a fit that finds a mismatch there has found that of the scheme: an effect that smooths it out would be named.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.evidence.residuals import block_power, standardised
from frictionjax.estimation.objective.joint import Joint, losses_of
from frictionjax.estimation.parameters import unpack

MOST = 4
"""The scheme is of second order: a sixteenth of the error of one step is left, of its power less than a hundredth."""


@eqx.filter_jit
def _differences(layout, vector, setting) -> Float[Array, "k r b"]:
    """Power in each block of what the innovations have more than those with four times the steps: with as many as the
    batch has, and with twice as many."""
    count = len(layout)
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])

    def seen(finer: int) -> Float[Array, "r n"]:
        return standardised(drive, vector[count:], setting.batch, setting.gains, finer=finer)

    best = seen(MOST)
    # Where the finest run is no number either, steps mend nothing.
    sound = jnp.isfinite(best)
    powers = [
        block_power(jnp.where(sound, seen(finer) - best, 0.0), setting.batch) for finer in (1, MOST // 2)
    ]
    return jnp.stack(powers)


def steps_needed(joint: Joint, vector: Float[Array, " q"], *, rule: Rule = Rule()) -> int:
    """Integration steps a sample with which the model at `vector` would not be thought inadequate for the error of the
    integration alone, on the fitted recordings and on those kept aside: once, twice or four times those of its batch.
    Where the motion is imposed, 1: its runs keep their own steps.
    """
    batch = joint.batch
    if not isinstance(batch, Batch):
        return 1
    own = batch.substeps
    seen, fitted = np.asarray(batch.block_mean(joint.setting.weight)), np.asarray(joint.fitted) > 0
    count = np.asarray(batch.block_count) * seen
    for finer, power in zip((1, MOST // 2), _differences(joint.layout, vector, joint.setting), strict=True):
        losses = losses_of(1.0 + np.asarray(power), batch) * seen
        parts = [losses[rows].sum() / max(count[rows].sum(), 1.0) for rows in (fitted, ~fitted)]
        if max(parts) < rule.limits.adequate:
            return finer * own
    return MOST * own


def with_steps(joint: Joint, steps: int) -> Joint:
    """The same with so many integration steps a sample, of recordings of an applied input."""
    batch = dataclasses.replace(joint.batch, substeps=steps)
    return eqx.tree_at(lambda own: own.setting.batch, joint, batch)
