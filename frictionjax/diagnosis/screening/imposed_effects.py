"""Under an imposed motion effects are simulated as they are: the motion is the same whatever the model."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive


def errors_with_effect(joints: list[Posterior], vectors: list[Float[Array, " q"]]) -> Float[Array, "k r n"]:
    """Standardised errors of the force for each of `vectors`, of models of one layout (`joints`, which may differ in
    what is not free), shape `(k, r, n)`."""
    posteriors = jax.tree.map(lambda *leaves: jnp.stack(leaves), *((one.drive, one.start) for one in joints))
    return _side_by_side(joints[0], *posteriors, jnp.stack([jnp.asarray(vector) for vector in vectors]))


@eqx.filter_jit
def _side_by_side(
    posterior: Posterior, drives: Drive, starts: Float[Array, "k q"], vectors: Float[Array, "k q"]
) -> Float[Array, "k r n"]:
    def lane(drive: Drive, start: Float[Array, " q"], vector: Float[Array, " q"]) -> Float[Array, "r n"]:
        own = eqx.tree_at(lambda p: (p.drive, p.start), posterior, (drive, start))
        return own.recordings.standardised(own.drive_of(vector), vector[own.parameters :])

    return jax.vmap(lane)(drives, starts, vectors)
