"""Equations (3) and (4): one linear system at the zero state, and a hull of them where the bristle is bent."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.physics import Drive, Linearization, linearize
from frictionjax.studies.level_sweep import table_one


class Linearised(eqx.Module):
    """The linearised drive at the zero state, and the extremes of its generalized Jacobian elsewhere.

    **Attributes:**

    - `stiffness`, `damping`: at the zero state, force per position unit and force s per position unit.
    - `natural_frequency`, `damping_ratio`: of (3) at the zero state, Hz and 1.
    - `unique_at_rest`: whether left and right Jacobian coincide at the zero state.
    - `bend`: deflections at which the extremes were computed, over break-away, `Fs / sigma0`, shape `(k,)`.
    - `stiffness_left`, `stiffness_right`: stiffness felt by a motion to the left and to the right, shape `(k,)`.
    - `damping_left`, `damping_right`: the damping, shape `(k,)`.
    """

    stiffness: float = eqx.field(static=True)
    damping: float = eqx.field(static=True)
    natural_frequency: float = eqx.field(static=True)
    damping_ratio: float = eqx.field(static=True)
    unique_at_rest: bool = eqx.field(static=True)
    bend: Float[np.ndarray, " k"]
    stiffness_left: Float[np.ndarray, " k"]
    stiffness_right: Float[np.ndarray, " k"]
    damping_left: Float[np.ndarray, " k"]
    damping_right: Float[np.ndarray, " k"]


@eqx.filter_jit
def _at(drive: Drive, deflections: Float[Array, " k"]) -> Linearization:
    return jax.vmap(lambda z: linearize(drive, z=z))(deflections)


def linearised(drive: Drive | None = None, *, points: int = 41) -> Linearised:
    """Linearise `drive` at rest, with its bristle straight and bent.

    **Arguments:**

    - `drive`: a drive without effects; that of Table I when absent.
    - `points`: number of deflections, from one break-away deflection to the other.

    **Returns:** the `Linearised`.

    **Raises:** `PrecisionError` unless JAX computes in float64.
    """
    drive = table_one() if drive is None else drive
    bend = np.linspace(-1.0, 1.0, points)
    bent = jnp.asarray(bend) * (drive.friction.Fs / drive.friction.sigma0)
    # The zero state is the first of the batch: one compilation for all.
    every = _at(drive, jnp.concatenate([jnp.zeros(1), bent]))
    zero, extremes = (jax.tree.map(lambda part, i=i: part[i], every) for i in (0, slice(1, None)))
    J = float(drive.J)

    def felt(
        matrices: Float[Array | np.ndarray, "k 3 3"],
    ) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Stiffness: what v adds to z (row 3), times what z takes from the force (row 2). Damping: row 2 itself."""
        matrices = np.asarray(matrices)
        return -J * matrices[:, 1, 2] * matrices[:, 2, 1], -J * matrices[:, 1, 1]

    (stiffness_left, damping_left), (stiffness_right, damping_right) = (
        felt(extremes.left),
        felt(extremes.right),
    )
    return Linearised(
        stiffness=float(zero.stiffness),
        damping=float(zero.damping),
        natural_frequency=float(zero.natural_frequency),
        damping_ratio=float(zero.damping_ratio),
        unique_at_rest=bool(zero.unique),
        bend=bend,
        stiffness_left=stiffness_left,
        stiffness_right=stiffness_right,
        damping_left=damping_left,
        damping_right=damping_right,
    )
