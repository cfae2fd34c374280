"""Base parameters: the combinations of masses, centres and inertias that the torques of an arm depend on."""

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Float, Int

from frictionjax.arm.rigid_body import RigidBody

_STATES = (
    60  # random states: each gives an equation a joint, so that there are several times as many as parameters
)
_ZERO = 1e-9  # of its size: what is left of a column that depends on earlier ones, which is rounding


class BaseParameters(eqx.Module):
    """The smallest set of numbers that gives every torque of an arm: Y pi = Y[:, kept] b, b = pi[kept] + K pi[other].

    **Attributes:**

    - `names`, `units`: of the parameters that lead the combinations, in the order of b.
    - `kept`: their places among all parameters of the model, shape `(b,)`.
    - `combine`: b of all parameters, shape `(b, p)`.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    kept: Int[np.ndarray, " b"]
    combine: Float[np.ndarray, "b p"]

    def regressor(
        self,
        arm: RigidBody,
        q: Float[np.ndarray, "n j"],
        qd: Float[np.ndarray, "n j"],
        qdd: Float[np.ndarray, "n j"],
    ) -> Float[np.ndarray, "n j b"]:
        """What each base parameter, at one, takes of each joint of the `arm` along the motion `q`, `qd`, `qdd`."""
        return arm.regressor(q, qd, qdd)[:, :, self.kept]

    def of(self, values: Float[np.ndarray, " p"]) -> Float[np.ndarray, " b"]:
        """The base parameters of the `values` of all parameters, shape `(b,)`."""
        return self.combine @ values


def base_parameters(arm: RigidBody) -> BaseParameters:
    """The base parameters of an `arm`: of the columns of its regressor at random states, those that do not depend on
    earlier ones (Gautier, "Numerical calculation of the base inertial parameters of robots", 1991)."""
    rng = np.random.default_rng(0)
    states = (rng.uniform(-np.pi, np.pi, (_STATES, len(arm.joints))) for _ in range(3))
    columns = arm.regressor(*states).reshape(-1, len(arm.parameters))
    size = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(size > 0.0, size, 1.0)
    left = np.abs(np.diag(scipy.linalg.qr(columns, mode="r")[0]))  # type: ignore[index]
    kept = np.flatnonzero(left > _ZERO)
    other = np.flatnonzero(left <= _ZERO)
    combine = np.zeros((kept.size, size.size))
    combine[np.arange(kept.size), kept] = 1.0
    weights = np.linalg.lstsq(columns[:, kept], columns[:, other], rcond=None)[0]
    weights = np.where(np.abs(weights) > _ZERO, weights, 0.0)
    combine[:, other] = weights * size[other] / size[kept][:, None]
    return BaseParameters(
        tuple(arm.parameters[k] for k in kept), tuple(arm.units[k] for k in kept), kept, combine
    )
