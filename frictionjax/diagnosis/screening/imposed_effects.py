"""Effects under an imposed motion are simulated directly: the motion does not depend on the model."""

from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.core.programs import compiled
from frictionjax.estimation.data.pieces import put_together
from frictionjax.estimation.evidence import AbstractRecordings
from frictionjax.estimation.objective.model import ParametricModel
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.physics import Drive


def errors_with_effect(
    posteriors: Sequence[Posterior], vectors: Sequence[Float[Numbers, " q"]]
) -> Float[np.ndarray, "k r n"]:
    """Standardised errors of the force for each of `vectors` of as many `posteriors`, which have one layout and may
    differ in fixed parameters, shape `(k, r, n)`."""
    recordings, count = posteriors[0].recordings, posteriors[0].parameters
    models = [one.model for one in posteriors]
    drives, centres = jax.tree.map(
        lambda *leaves: np.stack(leaves), *((one.drive, one.centre) for one in models)
    )
    stacked = np.stack([np.asarray(vector) for vector in vectors])
    parts = []
    for piece, own in recordings.in_pieces():
        z0 = stacked[:, count:][:, piece.lanes]
        parts.append((piece, _side_by_side(models[0], drives, centres, own, stacked[:, :count], z0)))
    return put_together(parts, recordings.rows, recordings.samples, axis=1)


@compiled()
def _side_by_side(
    model: ParametricModel,
    drives: Drive,
    centres: Float[Numbers, "k p"],
    recordings: AbstractRecordings,
    parameters: Float[Numbers, "k p"],
    z0: Float[Numbers, "k w"],
) -> Float[Numbers, "k w n"]:
    def lane(
        drive: Drive, centre: Float[Numbers, " p"], parameters: Float[Numbers, " p"], z0: Float[Numbers, " w"]
    ) -> Float[Numbers, "w n"]:
        return recordings.standardised(
            ParametricModel(model.constraints, drive, centre).drive_of(parameters), z0
        )

    return jax.vmap(lane)(drives, centres, parameters, z0)
