"""Estimates without the error of the integration: where a descent would have ended with finer steps.

Descents take one step a sample. Its error is a fraction of the noise, and yet biases stiffness and damping by several
standard errors where recordings are long. The slope of the errors does not need the finer steps, so that a few
evaluations of the errors themselves are all it costs.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.batch import Batch
from frictionjax.estimation.joint import Joint, Look
from frictionjax.estimation.least_squares import Setting
from frictionjax.estimation.parameters import unpack
from frictionjax.estimation.residuals import block_power, standardised

_SUBSTEPS = 4  # the scheme is of second order: a sixteenth of the error of one step is left
_ROUNDS = 5
_NEAR = 0.1  # standard deviations of a coordinate
_FARTHEST = 0.1  # in a coordinate, or a standard deviation of it: what moves further was never near a minimum


@eqx.filter_jit
def _finer_errors(layout, vector, setting: Setting) -> Float[Array, "r n"]:
    count = len(layout)
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
    return standardised(drive, vector[count:], setting.batch, setting.gains, substeps=_SUBSTEPS)


@eqx.filter_jit
def _weighted(columns, e, batch, fitted, count: int) -> Float[Array, " q"]:
    """Slope of the robust cost of the errors `e`; no parameter sees a recording that is kept aside."""
    weight = jnp.repeat(1.0 / (block_power(e, batch) + 1.0), batch.block, axis=-1) * batch.valid
    columns = columns.at[:count].multiply(fitted[None, :, None])
    return columns.reshape(columns.shape[0], -1) @ (weight * e).ravel()


def at_finer_steps(joint: Joint, vector: Float[Array, " q"], look: Look) -> Float[Array, " q"]:
    """The minimum of the robust cost with four integration steps a sample, by Newton steps with the matrix of one.

    **Arguments:**

    - `joint`: the model and the recordings.
    - `vector`: where the descent with one step a sample came to rest, shape `(q,)`.
    - `look`: there.

    **Returns:**

    The corrected vector, shape `(q,)`; `vector` itself under an imposed motion, whose runs keep their own steps, where
    its derivatives are not finite, and where the steps do not come to rest near it.
    """
    hessian = np.asarray(look.hessian)
    if not isinstance(joint.batch, Batch) or not np.all(np.isfinite(hessian)):
        return vector
    setting, count = joint.setting, len(joint.layout)
    _, columns = joint.errors_and_columns(vector)
    inverse = np.linalg.pinv(hessian, hermitian=True)
    unit = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    now, last = np.asarray(vector), np.inf
    for _ in range(_ROUNDS):
        e = _finer_errors(joint.layout, jnp.asarray(now), setting)
        slope = _weighted(columns, e, joint.batch, joint.fitted, count)
        step = -inverse @ (
            np.asarray(slope) + (now - np.asarray(setting.start)) * np.asarray(setting.prior) ** 2
        )
        length = float(np.max(np.abs(step / unit)))
        if not length < last:
            return vector
        now, last = now + step, length
        if np.any(np.abs(now - np.asarray(vector))[:count] > np.maximum(_FARTHEST, unit[:count])):
            return vector
        if length < _NEAR:
            return jnp.asarray(now)
    return vector
