"""The bank of bristles: the single LuGre bristle, and elasto-slip elements beside it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core.safe import sign
from frictionjax.physics.effects.base import AbstractBristleEffect, AbstractEffect

# An elasto-slip element slips gradually over the last part of its yield deflection: a corner that a step of
# finite length can resolve. With yields spread over the bank the sum does not show it.
_STICK = 0.7


class Bristles(eqx.Module):
    """Parallel elements; element 0 is LuGre's bristle.

    **Attributes:**

    - `share`: each element's part of the stiffness sigma0, shape `(n,)`, sum 1.
    - `slack`: each element's yield deflection over the mean one, shape `(n,)`, sum of share * slack 1.
    """

    share: Float[Array, " n"]
    slack: Float[Array, " n"]

    def rate(
        self, v: Float[Array, ""], z: Float[Array, " n"], level: Float[Array, ""], sigma0: Float[Array, ""]
    ) -> Float[Array, " n"]:
        """dz/dt of every element, position/s, shape `(n,)`: v minus |v| times the part that slips.

        LuGre's bristle slips in proportion to its deflection, equation (2); an elasto-slip element does not slip
        below its yield, nor when the velocity turns back.

        **Arguments:**

        - `v`: velocity, position/s.
        - `z`: deflection of each element, position units, shape `(n,)`.
        - `level`: steady-state friction level G, force.
        - `sigma0`: stiffness of the whole bank, force/position.
        """
        direction = sign(v)
        strain = sigma0 * z / (level * self.slack)
        yielding = direction * jnp.maximum(direction * strain - _STICK, 0.0) / (1.0 - _STICK)
        lugre = jnp.arange(z.shape[-1]) == 0
        return v - jnp.abs(v) * jnp.where(lugre, strain, yielding)


def bristles_of(effects: tuple[AbstractEffect, ...]) -> Bristles:
    """The bank that `effects` make of the single bristle."""
    share, slack = [], []
    for effect in effects:
        if isinstance(effect, AbstractBristleEffect):
            more_share, more_slack = effect.share_and_yield()
            share.append(more_share)
            slack.append(more_slack)
    if not share:
        return Bristles(jnp.ones(1), jnp.ones(1))
    added = jnp.concatenate(share)
    return Bristles(
        jnp.concatenate([1.0 - jnp.sum(added, keepdims=True), added]),
        jnp.concatenate([jnp.ones(1), *slack]),
    )


def bristle_count(effects: tuple[AbstractEffect, ...]) -> int:
    """Number of elements in the bank."""
    return 1 + sum(effect.count for effect in effects if isinstance(effect, AbstractBristleEffect))
