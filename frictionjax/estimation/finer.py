"""Estimates without the error of the integration: where a descent would have ended with finer steps.

Descents take as few steps a sample as pass for noise, most often one. Their error is a fraction of the noise, and yet
biases stiffness and damping by several standard errors where recordings are long. The slopes of the errors do not need
the finer steps, so that a few evaluations of the errors themselves are all it costs.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.joint import Joint, Look, sum_clusters
from frictionjax.estimation.least_squares import Setting
from frictionjax.estimation.parameters import unpack
from frictionjax.estimation.residuals import block_power, standardised

_SUBSTEPS = 8  # the scheme is of second order: 1/64 of the error of one step is left
# Always as many: where a break-away may come a sample sooner the cost is rough, and neither its fall nor the length of
# a step says when to stop. The first step does nearly all.
_ROUNDS = 3
_FARTHEST = 0.1  # in a coordinate, or a standard deviation of it: what moves further was never near a minimum


class Finer(NamedTuple):
    """Where finer steps lead: the corrected `vector`, shape `(q,)`, whether they led `away` (then it is the vector of
    few steps), and the gradients there of each cluster of 0.5 s, without the prior, shape `(c, q)`."""

    vector: Float[Array, " q"]
    away: bool
    clusters: Float[np.ndarray, "c q"]


@eqx.filter_jit
def _gradients(layout, vector, columns, setting: Setting, fitted) -> Float[Array, "c q"]:
    """Slopes of the robust cost of the errors with finer steps, cluster by cluster, by the `columns` of few steps; no
    parameter sees a recording that is kept aside."""
    count, batch = len(layout), setting.batch
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
    e = standardised(drive, vector[count:], batch, setting.gains, finer=_SUBSTEPS)
    weight = jnp.repeat(1.0 / (block_power(e, batch) + 1.0), batch.block, axis=-1) * setting.weight
    seen = columns.at[:count].multiply(fitted[None, :, None])
    return sum_clusters(seen * (weight * e)[None], batch.block)


def at_finer_steps(joint: Joint, vector: Float[Array, " q"], look: Look) -> Finer:
    """The minimum of the robust cost with eight times the integration steps, by Newton steps with the matrix of few.

    Where the steps lead away, under an imposed motion, whose runs keep their own steps, and where derivatives are not
    finite, it is `vector` itself, with the gradients of few steps.

    **Arguments:**

    - `joint`: the model and the recordings.
    - `vector`: where the descent with few steps came to rest, shape `(q,)`.
    - `look`: there.
    """
    hessian, prior = np.asarray(look.hessian), np.asarray(joint.setting.prior)
    few = Finer(vector, False, np.asarray(look.clusters))
    if not isinstance(joint.batch, Batch) or not np.all(np.isfinite(hessian)):
        return few
    count, start = len(joint.layout), np.asarray(joint.setting.start)
    _, columns = joint.errors_and_columns(vector)
    inverse = np.linalg.pinv(hessian, hermitian=True)
    # What the recordings do not show stays: the prior alone would draw it to where the fit began.
    shown = np.diag(hessian) > 2.0 * prior**2
    now = np.asarray(vector)

    def gradients() -> np.ndarray:
        return np.asarray(_gradients(joint.layout, jnp.asarray(now), columns, joint.setting, joint.fitted))

    for _ in range(_ROUNDS):
        slope = gradients().sum(axis=0) + (now - start) * prior**2
        now = now - np.where(shown, inverse @ slope, 0.0)
    moved = np.abs(now - np.asarray(vector))[:count]
    bound = np.maximum(_FARTHEST, np.sqrt(np.maximum(np.diag(inverse), 0.0)))[:count]
    if not np.all(moved < bound):
        return few._replace(away=True)
    return Finer(jnp.asarray(now), False, gradients())
