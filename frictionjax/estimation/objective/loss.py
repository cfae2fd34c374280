"""Robust losses, one a class: the cost of a block of samples by its mean square b, in units of the noise power."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import Float

from frictionjax.core.arrays import Numbers, known, numpy_or_jax
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.core.safe import real


class AbstractLoss(PlainMethods, eqx.Module):
    """Cost rho of the mean square b of a block: the whole is 1/2 sum of n rho(b), n samples in it; rho is concave."""

    @abstractmethod
    def cost(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """rho(b), without unit, for blocks of mean square `power`; 0 at 0."""

    @abstractmethod
    def weight(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """d rho / db at `power`: the weight of each square."""


class Gaussian(AbstractLoss):
    """rho = b: least squares. Right when the noise is known and the model holds everywhere."""

    def cost(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """rho = b, for `power` b."""
        return power

    def weight(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """1, whatever the `power`."""
        return numpy_or_jax(power).ones_like(power)


GRADUATION = (0.95, 0.8, 0.5)
"""Quantiles of the block powers that set the scale of the loss, in turn, before it is at the noise: those above it."""


class Cauchy(AbstractLoss):
    """rho = (1 + t^2) log(1 + b/t^2): every block counts by its relative error, and one break-away cannot outvote all.

    **Attributes:** `knee`: scale of the loss t^2, the mean square (in noise powers) from which on a block loses weight.
    """

    knee: Float[Numbers, ""] = eqx.field(converter=real, default=1.0)

    def cost(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """rho(b), for `power` b."""
        xp, (power, knee) = known(power, self.knee)
        return (1.0 + knee) * xp.log1p(power / knee)

    def weight(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """(1 + t^2) / (b + t^2), for `power` b: 1 for a block at the noise."""
        _, (power, knee) = known(power, self.knee)
        return (1.0 + knee) / (power + knee)


class Huber(AbstractLoss):
    """rho = b up to the scale t^2, then 2 t sqrt(b) - t^2: the influence of an outlier is constant. Convex.

    **Attributes:** `knee`: scale of the loss t^2, the mean square (in noise powers) up to which squares count fully.
    """

    knee: Float[Numbers, ""] = eqx.field(converter=real, default=4.0)

    def cost(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """rho(b), for `power` b."""
        xp, (power, knee) = known(power, self.knee)
        beyond = xp.maximum(power, knee)
        return xp.where(power < knee, power, 2.0 * xp.sqrt(knee * beyond) - knee)

    def weight(self, power: Float[Numbers, "..."]) -> Float[Numbers, "..."]:
        """1 up to the scale t^2, then t / sqrt(b), for `power` b."""
        xp, (power, knee) = known(power, self.knee)
        return xp.sqrt(knee / xp.maximum(power, knee))
