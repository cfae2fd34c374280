"""Motor force that changes within a sample."""

import equinox as eqx
from jaxtyping import Array, Float


class Push(eqx.Module):
    """An input or a force that rises linearly within each sample.

    Its mean over a sample decides the velocity that a mass reaches, its first moment the position: a line with the same
    mean and first moment replaces whatever it does within the sample.

    **Attributes:** `mean` of each sample; `rise`, from the beginning of the sample to its end: -12 d with d = (second
    integral over the sample)/dt^2 - mean/2, 0 for a constant one. Of one shape, `(n,)` or `()`.
    """

    mean: Float[Array, "..."]
    rise: Float[Array, "..."]

    def __add__(self, held: Float[Array, "..."]) -> "Push":
        """The sum with a force that is `held` over each sample."""
        return Push(self.mean + held, self.rise)


def mean_of(push: Float[Array, "..."] | Push) -> Float[Array, "..."]:
    """Mean over each sample of a force that is held or a `Push`.

    **Arguments:**

    - `push`: held, shape `(n,)` or `()`, or a `Push`.
    """
    return push.mean if isinstance(push, Push) else push
