"""Estimates without the error of the integration: the minimum that finer integration steps would have.

Descents integrate with so few steps a sample, most often one, that the error stays below the noise. It still biases
stiffness and damping by several standard errors where recordings are long. The derivatives of the errors do not need
finer steps, so that the correction costs a few evaluations of the errors themselves.
"""

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic, all_columns

SUBSTEPS = 8  # the scheme is of second order: 1/64 of the error of one step is left
# Always as many: where a break-away may come a sample sooner the cost is rough, and neither its fall nor the length of
# a step says when to stop. The first step does nearly all.
ROUNDS = 3
# In a coordinate, or in standard deviations of it: a correction that is larger did not start near a minimum.
_LARGEST_CHANGE, _LARGEST_IN_DEVIATIONS = 0.1, 2.0**0.5


def _slope(
    posterior: Posterior, vector: Float[np.ndarray, " q"], columns: Float[np.ndarray, "q r n"]
) -> Float[np.ndarray, " q"]:
    """Gradient of the robust cost at the integration steps of the `posterior`, by `columns` in which held-out
    recordings determine no parameter."""
    e, start, prior = posterior.errors_at([vector])[0], posterior.start, np.asarray(posterior.prior)
    scale = posterior.loss.weight(block_power(e, posterior.batch))
    weight = np.repeat(scale, posterior.batch.block, axis=-1) * posterior.sample_weight
    slope = columns.reshape(len(columns), -1) @ (weight * e).ravel()
    return slope + (vector - np.asarray(start)) * prior**2


def at_finer_steps(
    posterior: Posterior, vector: Float[Numbers, " q"], near: Quadratic, evaluation: Evaluation
) -> tuple[Float[np.ndarray, " q"], bool]:
    """The minimum of the robust cost with eight times the integration steps, by Newton steps with the matrix of few.

    **Arguments:**

    - `posterior`: the model and the recordings.
    - `vector`: where the descent with few steps came to rest, shape `(q,)`.
    - `near`, `evaluation`: there.

    **Returns:**

    The corrected vector, shape `(q,)`, and whether the steps led away: then, as under an imposed motion, whose runs
    keep their own steps, and where derivatives are not finite, it is `vector` itself.
    """
    hessian, vector = np.asarray(near.hessian), np.asarray(vector)
    if posterior.batch.imposed or not np.all(np.isfinite(hessian)):
        return vector, False
    count, fine = posterior.parameters, posterior.with_substeps(SUBSTEPS * posterior.batch.substeps)
    columns = np.array(all_columns(evaluation))
    columns[:count] *= np.asarray(posterior.fitted[0])[:, None]
    inverse = np.linalg.pinv(hessian, hermitian=True)
    # Coordinates that the recordings do not determine stay: the prior alone would draw them to the start.
    determined = np.diag(hessian) > 2.0 * np.asarray(posterior.prior) ** 2
    now = vector
    for _ in range(ROUNDS):
        now = now - np.where(determined, inverse @ _slope(fine, now, columns), 0.0)
    moved = np.abs(now - vector)[:count]
    deviations = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    away = not np.all(moved < np.maximum(_LARGEST_CHANGE, _LARGEST_IN_DEVIATIONS * deviations)[:count])
    return (vector if away else now), away
