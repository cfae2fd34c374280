"""Estimates without the error of the integration: where a descent would have ended with finer steps.

Descents take as few steps a sample as pass for noise, most often one. Their error is a fraction of the noise, and yet
biases stiffness and damping by several standard errors where recordings are long. The slopes of the errors do not need
the finer steps, so that a few evaluations of the errors themselves are all it costs.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import Batch
from frictionjax.estimation.evidence.residuals import block_power, standardised
from frictionjax.estimation.objective.joint import Joint
from frictionjax.estimation.objective.look import Look, Seen, told_columns
from frictionjax.estimation.objective.setting import Setting
from frictionjax.estimation.parameters import unpack

_SUBSTEPS = 8  # the scheme is of second order: 1/64 of the error of one step is left
# Always as many: where a break-away may come a sample sooner the cost is rough, and neither its fall nor the length of
# a step says when to stop. The first step does nearly all.
_ROUNDS = 3
_FARTHEST = 0.1  # in a coordinate, or a standard deviation of it: what moves further was never near a minimum


@eqx.filter_jit
def _slope(layout, vector, columns, setting: Setting, fitted) -> Float[Array, " q"]:
    """Slope of the robust cost of the errors with finer steps, by the `columns` of few steps; no parameter sees
    a recording that is kept aside."""
    count, batch = len(layout), setting.batch
    drive = unpack(layout, setting.drive, vector[:count], setting.start[:count])
    e = standardised(drive, vector[count:], batch, setting.gains, finer=_SUBSTEPS)
    weight = jnp.repeat(1.0 / (block_power(e, batch) + 1.0), batch.block, axis=-1) * setting.weight
    seen = columns.at[:count].multiply(fitted[None, :, None]).reshape(columns.shape[0], -1)
    return seen @ (weight * e).ravel() + (vector - setting.start) * setting.prior**2


def at_finer_steps(
    joint: Joint, vector: Float[Array, " q"], look: Look, seen: Seen
) -> tuple[Float[Array, " q"], bool]:
    """The minimum of the robust cost with eight times the integration steps, by Newton steps with the matrix of few.

    **Arguments:**

    - `joint`: the model and the recordings.
    - `vector`: where the descent with few steps came to rest, shape `(q,)`.
    - `look`, `seen`: there.

    **Returns:**

    The corrected vector, shape `(q,)`, and whether the steps led away: then, as under an imposed motion, whose runs
    keep their own steps, and where derivatives are not finite, it is `vector` itself.
    """
    hessian = np.asarray(look.hessian)
    if not isinstance(joint.batch, Batch) or not np.all(np.isfinite(hessian)):
        return vector, False
    count = len(joint.layout)
    columns = told_columns(seen, joint.batch.block)
    inverse = np.linalg.pinv(hessian, hermitian=True)
    # What the recordings do not show stays: the prior alone would draw it to where the fit began.
    shown = np.diag(hessian) > 2.0 * np.asarray(joint.setting.prior) ** 2
    now = np.asarray(vector)
    for _ in range(_ROUNDS):
        slope = _slope(joint.layout, jnp.asarray(now), columns, joint.setting, joint.fitted)
        now = now - np.where(shown, inverse @ np.asarray(slope), 0.0)
    moved = np.abs(now - np.asarray(vector))[:count]
    bound = np.maximum(_FARTHEST, np.sqrt(np.maximum(np.diag(inverse), 0.0)))[:count]
    away = not np.all(moved < bound)
    return (vector if away else jnp.asarray(now)), away
