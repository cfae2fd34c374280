"""A model with free parameters on a piece of evidence: its errors and their derivatives, as compiled programs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.core.programs import compiled
from frictionjax.estimation.constraints import Constraints
from frictionjax.estimation.evidence import AbstractEvidence, AbstractRecordings
from frictionjax.estimation.parameters import part_of, unpack
from frictionjax.physics import Drive


class ParametricModel(PlainMethods, eqx.Module):
    """What turns free parameters into a `Drive`.

    **Attributes:** `constraints`, `drive` (structure and fixed parameters), `centre` of the admissible ranges, `(p,)`.
    """

    constraints: Constraints
    drive: Drive
    centre: Float[Numbers, " p"]

    def drive_of(self, parameters: Float[Numbers, " p"]) -> Drive:
        """The `Drive` of these free `parameters`, shape `(p,)`."""
        return self.constraints.tied(unpack(self.constraints.layout, self.drive, parameters, self.centre))

    def values_of(self, parameters: Float[Numbers, " p"]) -> Float[Numbers, " k"]:
        """Physical values of the free and then of the tied parameters, at free `parameters`, shape `(p,)`."""
        drive = self.drive_of(parameters)
        paths = [one.path for one in (*self.constraints.layout, *self.constraints.ties)]
        return jnp.stack([part_of(drive, path) for path in paths])


def physical(
    model: ParametricModel, parameters: Float[Numbers, " p"]
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k p"]]:
    """Physical values of the free and then of the tied parameters of `model`, shape `(k,)`, and their Jacobian by the
    free `parameters`, shape `(k, p)`: for the delta method."""
    values, jacobian = _physical(model, parameters)
    return np.asarray(values), np.asarray(jacobian)


@compiled()
def _physical(
    model: ParametricModel, parameters: Float[Numbers, " p"]
) -> tuple[Float[Numbers, " k"], Float[Numbers, "k p"]]:
    return model.values_of(parameters), jax.jacfwd(model.values_of)(parameters)


# Higher levels of XLA compile for longer, and the loop is no faster for it.
@compiled(options={"xla_backend_optimization_level": 1})
def with_slopes(
    model: ParametricModel,
    evidence: AbstractEvidence,
    parameters: Float[Numbers, " p"],
    z0: Float[Numbers, " w"],
) -> tuple[Float[Numbers, "w n"], Float[Numbers, "k w n"]]:
    """Errors of a piece of evidence, and the columns of their derivatives by the parameters and by each own starting
    deflection."""
    count, rows = parameters.shape[0], z0.shape[0]

    def errors(parameters: Float[Numbers, " p"], z0: Float[Numbers, " w"]) -> Float[Numbers, "w n"]:
        return evidence.errors(model.drive_of(parameters), z0).reshape(max(rows, 1), -1)

    def column(way: Float[Numbers, " k"]) -> tuple[Float[Numbers, "w n"], Float[Numbers, "w n"]]:
        # A starting deflection moves its own recording only, so one column serves all of them.
        return jax.jvp(errors, (parameters, z0), (way[:count], way[-1] * jnp.ones(rows)))

    return jax.vmap(column, out_axes=(None, 0))(jnp.eye(count + (rows > 0), count + 1))


@compiled()
def side_by_side(
    model: ParametricModel,
    recordings: AbstractRecordings,
    parameters: Float[Numbers, "k p"],
    z0: Float[Numbers, "k w"],
) -> Float[Numbers, "k w n"]:
    """Standardised errors of a piece for each of k vectors."""
    return recordings.side_by_side(jax.vmap(model.drive_of)(parameters), z0)
