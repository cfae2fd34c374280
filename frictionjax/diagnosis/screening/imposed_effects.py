"""Under an imposed motion effects are simulated as they are: the motion is the same whatever the model."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.evidence.residuals import standardised
from frictionjax.estimation.objective.joint import Joint
from frictionjax.estimation.parameters import unpack


def errors_with_effect(joints: list[Joint], vectors: list[Float[Array, " q"]]) -> Float[Array, "k r n"]:
    """Standardised errors of the force for each of `vectors`, of models of one layout (`joints`, which may differ in
    what is not free), shape `(k, r, n)`."""
    drives = jax.tree.map(lambda *leaves: jnp.stack(leaves), *(joint.setting.drive for joint in joints))
    starts = jnp.stack([joint.setting.start for joint in joints])
    stack = jnp.stack([jnp.asarray(vector) for vector in vectors])
    return _lanes(joints[0].layout, drives, starts, stack, joints[0].setting)


@eqx.filter_jit
def _lanes(layout, drives, starts, vectors, setting):
    count = len(layout)

    def lane(drive, start, vector):
        drive = unpack(layout, drive, vector[:count], start[:count])
        return standardised(drive, vector[count:], setting.batch, setting.gains)

    return jax.vmap(lane)(drives, starts, vectors)
