"""Effects under an imposed motion are simulated directly: the motion does not depend on the model."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive


def errors_with_effect(
    posteriors: Sequence[Posterior], vectors: Sequence[Float[Array | np.ndarray, " q"]]
) -> Float[Array, "k r n"]:
    """Standardised errors of the force for each of `vectors` of as many `posteriors`, which have one layout and may
    differ in fixed parameters, shape `(k, r, n)`."""
    drives, starts = jax.tree.map(
        lambda *leaves: jnp.stack(leaves), *((one.drive, one.start) for one in posteriors)
    )
    stacked = jnp.stack([jnp.asarray(vector) for vector in vectors])
    return _side_by_side(posteriors[0], drives, starts, stacked)


@eqx.filter_jit
def _side_by_side(
    posterior: Posterior, drives: Drive, starts: Float[Array, "k q"], vectors: Float[Array, "k q"]
) -> Float[Array, "k r n"]:
    def lane(drive: Drive, start: Float[Array, " q"], vector: Float[Array, " q"]) -> Float[Array, "r n"]:
        own = eqx.tree_at(lambda p: (p.drive, p.start), posterior, (drive, start))
        return own.recordings.standardised(own.drive_of(vector), vector[own.parameters :])

    return jax.vmap(lane)(drives, starts, vectors)
