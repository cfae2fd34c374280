"""Motor force that changes within a sample."""

import equinox as eqx
from jaxtyping import Array, Float


class Push(eqx.Module):
    """An input or a force that rises linearly within each sample.

    Whatever it does within a sample, a mass is moved to the same velocity by its mean and to the same position by its
    first moment; the line that has both stands for it.

    **Attributes:** `mean` of each sample; `rise`, from the beginning of the sample to its end: -12 d with d = (second
    integral over the sample)/dt^2 - mean/2, which is 0 where it is held. Of one shape, `(n,)` or `()`.
    """

    mean: Float[Array, "..."]
    rise: Float[Array, "..."]

    def __add__(self, held: Float[Array, "..."]) -> "Push":
        """The same beside a force that is `held` over each sample."""
        return Push(self.mean + held, self.rise)


def mean_of(push: Float[Array, "..."] | Push) -> Float[Array, "..."]:
    """Mean over each sample of a force that may be held or not.

    **Arguments:**

    - `push`: held, shape `(n,)` or `()`, or a `Push`.
    """
    return push.mean if isinstance(push, Push) else push
