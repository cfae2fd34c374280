"""Power of standardised errors in blocks, and sums over clusters of blocks."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from frictionjax.estimation.data.batch import CLUSTER, AbstractBatch


def block_power(e: Float[Array, "r n"], batch: AbstractBatch) -> Float[Array, "r b"]:
    """Mean square of the standardised errors in each block, shape `(r, b)`."""
    return batch.block_mean(e * e)


@eqx.filter_jit
def lane_powers(e: Float[Array, "k r n"], batch: AbstractBatch) -> Float[Array, "k r b"]:
    """The `block_power` of several models' errors."""
    return jax.vmap(lambda lane: block_power(lane, batch))(e)


def sum_clusters(values: Float[Array, "q r n"], block: int, blocks: int = CLUSTER) -> Float[Array, "c q"]:
    """Sums of `values` over clusters of `blocks` blocks of `block` samples, shape `(c, q)`; none across recordings."""
    length = block * blocks
    padded = jnp.pad(values, ((0, 0), (0, 0), (0, -values.shape[-1] % length)))
    return padded.reshape(values.shape[0], -1, length).sum(-1).T
