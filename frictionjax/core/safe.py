"""Non-smooth maths that is safe to differentiate at rest, where v = 0 exactly."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Real


def real(value: Real[ArrayLike, "..."] | Bool[ArrayLike, "..."]) -> Float[Array, "..."]:
    """`value` as an array of JAX's default real type: a number passed in is data, not a constant to compile in."""
    dtype = jax.dtypes.canonicalize_dtype(float)
    if isinstance(value, jax.Array) and value.dtype == dtype and not value.weak_type:
        return value  # JAX takes 70 us to find that out
    return jnp.asarray(value, dtype=dtype)


def sign(v: Float[Array, "..."]) -> Float[Array, "..."]:
    """Sign of `v`, +1 at v = 0 (never 0), with zero derivative.

    It only ever multiplies |v| or selects a branch that is multiplied by |v|, so what it enters is continuous.
    """
    return jnp.where(v < 0.0, -1.0, 1.0)


def power(base: Float[Array, "..."], exponent: Float[Array, "..."]) -> Float[Array, "..."]:
    """`base ** exponent` for base >= 0 with finite derivatives in both arguments at base = 0 (exponent > 0)."""
    positive = jnp.where(base > 1e-150, base, 1.0)
    return jnp.where(base > 1e-150, jnp.exp(exponent * jnp.log(positive)), 0.0)
