"""Estimates without the error of the integration: the minimum that finer integration steps would have.

Descents integrate with so few steps a sample, most often one, that the error stays below the noise. It still biases
stiffness and damping by several standard errors where recordings are long. The derivatives of the errors do not need
finer steps, so that the correction costs a few evaluations of the errors themselves.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.evidence.power import block_power
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic, all_columns

_SUBSTEPS = 8  # the scheme is of second order: 1/64 of the error of one step is left
# Always as many: where a break-away may come a sample sooner the cost is rough, and neither its fall nor the length of
# a step says when to stop. The first step does nearly all.
_ROUNDS = 3
# In a coordinate, or in standard deviations of it: a correction that is larger did not start near a minimum.
_LARGEST_CHANGE, _LARGEST_IN_DEVIATIONS = 0.1, 2.0**0.5


@eqx.filter_jit
def _slope(
    posterior: Posterior, vector: Float[Array, " q"], columns: Float[Array, "q r n"]
) -> Float[Array, " q"]:
    """Gradient of the robust cost with finer integration steps, by the `columns` of few steps; held-out recordings
    determine no parameter."""
    count, batch = posterior.parameters, posterior.batch
    e = posterior.recordings.standardised(posterior.drive_of(vector), vector[count:], finer=_SUBSTEPS)
    scale = posterior.loss.weight(block_power(e, batch))
    weight = jnp.repeat(scale, batch.block, axis=-1) * posterior.sample_weight
    fitted = columns.at[:count].multiply(posterior.fitted[0][None, :, None]).reshape(columns.shape[0], -1)
    return fitted @ (weight * e).ravel() + (vector - posterior.start) * posterior.prior**2


def at_finer_steps(
    posterior: Posterior, vector: Float[Array, " q"], near: Quadratic, evaluation: Evaluation
) -> tuple[Float[Array, " q"], bool]:
    """The minimum of the robust cost with eight times the integration steps, by Newton steps with the matrix of few.

    **Arguments:**

    - `posterior`: the model and the recordings.
    - `vector`: where the descent with few steps came to rest, shape `(q,)`.
    - `near`, `evaluation`: there.

    **Returns:**

    The corrected vector, shape `(q,)`, and whether the steps led away: then, as under an imposed motion, whose runs
    keep their own steps, and where derivatives are not finite, it is `vector` itself.
    """
    hessian = np.asarray(near.hessian)
    if posterior.batch.imposed or not np.all(np.isfinite(hessian)):
        return vector, False
    count, columns = posterior.parameters, all_columns(evaluation)
    inverse = np.linalg.pinv(hessian, hermitian=True)
    # Coordinates that the recordings do not determine stay: the prior alone would draw them to the start.
    determined = np.diag(hessian) > 2.0 * np.asarray(posterior.prior) ** 2
    now = np.asarray(vector)
    for _ in range(_ROUNDS):
        slope = _slope(posterior, jnp.asarray(now), columns)
        now = now - np.where(determined, inverse @ np.asarray(slope), 0.0)
    moved = np.abs(now - np.asarray(vector))[:count]
    deviations = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    away = not np.all(moved < np.maximum(_LARGEST_CHANGE, _LARGEST_IN_DEVIATIONS * deviations)[:count])
    return (vector if away else jnp.asarray(now)), away
