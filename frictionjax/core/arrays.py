"""Arrays of NumPy and of JAX: the same formulas for numbers that are known and inside transformations."""

from types import ModuleType
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, PyTree

if TYPE_CHECKING:
    # Their operators mix, which a checker that knows one type for each cannot follow.
    Numbers = Any
else:
    Numbers = Array | np.ndarray | np.generic
    """An array of either library; NumPy's arithmetic makes a scalar of its own of one without axes."""


def numpy_or_jax(*trees: PyTree) -> ModuleType:
    """NumPy where the numbers in `trees` are known, else JAX.

    Outside of a transformation JAX compiles each operation by itself, and again for each shape.
    """
    return jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees)) else np


def known(*trees: PyTree) -> tuple[ModuleType, PyTree]:
    """`numpy_or_jax`, and the `trees` with arrays of that library: operators compile nothing, either."""
    xp = numpy_or_jax(*trees)
    return xp, jax.device_get(trees) if xp is np else trees
