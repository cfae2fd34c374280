"""Robust losses, one a class: the cost of a block of samples by its mean square b, in units of the noise power."""

from abc import abstractmethod

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.core.safe import real


class AbstractLoss(eqx.Module):
    """Cost rho of the mean square b of a block: the whole is 1/2 sum of n rho(b), n samples in it; rho is concave."""

    @abstractmethod
    def cost(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """rho(b), without unit, for blocks of mean square `power`; 0 at 0."""

    @abstractmethod
    def weight(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """d rho / db at `power`: the weight of each square."""


class Gaussian(AbstractLoss):
    """rho = b: least squares. Right when the noise is known and the model holds everywhere."""

    def cost(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """rho = b, for `power` b."""
        return power

    def weight(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """1, whatever the `power`."""
        return jnp.ones_like(power)


class Cauchy(AbstractLoss):
    """rho = (1 + t^2) log(1 + b/t^2): every block counts by its relative error, and one break-away cannot outvote all.

    **Attributes:** `knee`: scale of the loss t^2, the mean square (in noise powers) from which on a block loses weight.
    """

    knee: Float[Array, ""] = eqx.field(converter=real, default=1.0)

    def cost(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """rho(b), for `power` b."""
        return (1.0 + self.knee) * jnp.log1p(power / self.knee)

    def weight(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """(1 + t^2) / (b + t^2), for `power` b: 1 for a block at the noise."""
        return (1.0 + self.knee) / (power + self.knee)


class Huber(AbstractLoss):
    """rho = b up to the scale t^2, then 2 t sqrt(b) - t^2: the influence of an outlier is constant. Convex.

    **Attributes:** `knee`: scale of the loss t^2, the mean square (in noise powers) up to which squares count fully.
    """

    knee: Float[Array, ""] = eqx.field(converter=real, default=4.0)

    def cost(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """rho(b), for `power` b."""
        beyond = jnp.maximum(power, self.knee)
        return jnp.where(power < self.knee, power, 2.0 * jnp.sqrt(self.knee * beyond) - self.knee)

    def weight(self, power: Float[Array, "..."]) -> Float[Array, "..."]:
        """1 up to the scale t^2, then t / sqrt(b), for `power` b."""
        return jnp.sqrt(self.knee / jnp.maximum(power, self.knee))
