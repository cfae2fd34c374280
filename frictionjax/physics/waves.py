"""Waves: periodic functions of position or time."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Parts = tuple[Float[Array, "..."], Float[Array, "..."]]
"""Sine and cosine part of a wave."""


def wave(turns: Float[Array, "..."], *parts: Parts) -> Float[Array, "..."]:
    """Sum of sine_k sin(2 pi k turns) + cosine_k cos(2 pi k turns) over the `parts` (sine_k, cosine_k), k = 1, 2, ...

    **Arguments:** `turns`: the argument in periods of the first one.
    """
    angle = 2.0 * jnp.pi * turns
    terms = [
        sine * jnp.sin(k * angle) + cosine * jnp.cos(k * angle)
        for k, (sine, cosine) in enumerate(parts, start=1)
    ]
    return sum(terms[1:], terms[0])
