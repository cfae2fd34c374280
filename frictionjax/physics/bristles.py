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

    def rate(
        self,
        v: Float[Array, ""],
        z: Float[Array, " n"],
        level: Float[Array, ""],
        sigma0: Float[Array, ""],
        h: Float[Array, ""],
    ) -> Float[Array, " n"]:
        """dz/dt of every element, position/s, shape `(n,)`.

        LuGre's bristle slips in proportion to its deflection, equation (2). An elasto-slip element moves with the
        machine up to its yield deflection; its rate is the mean over the next `h` s, because at the yield, whose level
        changes with velocity, the rate of an instant would jump between 0 and v.

        **Arguments:**

        - `v`: velocity, position/s.
        - `z`: deflection of each element, position units, shape `(n,)`.
        - `level`: steady-state friction level G, force.
        - `sigma0`: stiffness of the whole bank, force/position.
        - `h`: time over which an elasto-slip element's rate is the mean, s.
        """
        limit = level * self.slack / sigma0
        slip = v - jnp.abs(v) * z / limit
        return jnp.where(self._lugre, slip, jnp.clip(v, (-limit - z) / h, (limit - z) / h))

    def after(
        self,
        z: Float[Array, " n"],
        integrated: Float[Array, " n"],
        travel: Float[Array, ""],
        level: Float[Array, ""],
        sigma0: Float[Array, ""],
    ) -> Float[Array, " n"]:
        """Deflections after a step.

        An elasto-slip element that was at `z` has moved with the machine by `travel`, but not beyond its yield: exact,
        however long the step. LuGre's bristle is where the integration of its rate put it (`integrated`).

        **Arguments:** `z`, `integrated` (position units, shape `(n,)`), `travel` (position units), `level` (force),
        `sigma0` (force/position).
        """
        limit = level * self.slack / sigma0
        return jnp.where(self._lugre, integrated, jnp.clip(z + travel, -limit, limit))

    @property
    def _lugre(self) -> Bool[Array, " n"]:
        return jnp.arange(self.share.shape[-1]) == 0


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
