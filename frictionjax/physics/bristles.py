"""The bank of bristles: the single LuGre bristle, and elasto-slip elements beside it."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from frictionjax.physics.effects.base import AbstractBristleEffect, AbstractEffect


class Bristles(eqx.Module):
    """Parallel elements; element 0 is LuGre's bristle.

    **Attributes:**

    - `share`: each element's part of the stiffness sigma0, shape `(n,)`, sum 1.
    - `slack`: each element's yield deflection over the mean one, shape `(n,)`, sum of share * slack 1.
    """

    share: Float[Array, " n"]
    slack: Float[Array, " n"]

    @property
    def lugre(self) -> Bool[Array, " n"]:
        """True for LuGre's element."""
        return jnp.arange(self.share.shape[-1]) == 0

    def limit(self, level: Float[Array, ""], sigma0: Float[Array, ""]) -> Float[Array, " n"]:
        """Deflection at which each element slips steadily, position units, for a friction `level` (force) and the
        stiffness `sigma0` of the whole bank (force/position).
        """
        return level * self.slack / sigma0

    def cut(self, z: Float[Array, " m"], limit: Float[Array, " m"]) -> Float[Array, " m"]:
        """Deflections `z` of elasto-slip elements, clipped to their `limit`; position units, shape `(m,)`."""
        # In the innermost loop: cheaper than a clip, and so is its derivative.
        return jnp.where(jnp.abs(z) < limit, z, jnp.where(z > 0.0, limit, -limit))

    def within(self, z: Float[Array, " n"], limit: Float[Array, " n"]) -> Float[Array, " n"]:
        """Deflections `z`, with those of elasto-slip elements clipped to their `limit`; LuGre's bristle follows (2)."""
        return jnp.where(self.lugre, z, jnp.clip(z, -limit, limit))

    def rate(
        self,
        v: Float[Array, ""],
        fast: Float[Array, ""],
        bend: Float[Array, "..."],
        stick: Float[Array, " n"] | Float[Array, ""],
    ) -> Float[Array, " n"]:
        """dz/dt of every element, position/s, shape `(n,)`, as it counts for damping.

        LuGre's bristle slips in proportion to its deflection, equation (2). An elasto-slip element moves with the
        machine until it yields, and again as soon as the velocity turns back; while it slips its rate is zero.

        **Arguments:**

        - `v`: velocity of the bristles, position/s.
        - `fast`: velocity at which LuGre's slips, position/s: the same unless an element in series creeps.
        - `bend`: force of LuGre's bristle over the friction level G, sigma0 z/G; scalar, or one per element.
        - `stick`: velocity of the elasto-slip elements, or its mean over a step in which they yield, position/s.
        """
        return jnp.where(self.lugre, v - jnp.abs(fast) * bend, stick)


def bristles_of(effects: tuple[AbstractEffect, ...]) -> Bristles:
    """The bank of bristles with `effects`."""
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
