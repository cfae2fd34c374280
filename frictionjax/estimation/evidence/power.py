"""Power of standardised errors in blocks, and sums over clusters of blocks."""

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers, known
from frictionjax.estimation.data.batch import CLUSTER, AbstractBatch


def block_power(e: Float[Numbers, "*k r n"], batch: AbstractBatch) -> Float[Numbers, "*k r b"]:
    """Mean square of the standardised errors in each block, of one model or of several, shape `(..., r, b)`."""
    _, (e,) = known(e)
    return batch.block_mean(e * e)


def sum_clusters(values: Float[Numbers, "q r n"], block: int, blocks: int = CLUSTER) -> Float[Numbers, "c q"]:
    """Sums of `values` over clusters of `blocks` blocks of `block` samples, shape `(c, q)`; none across recordings."""
    xp, (values,) = known(values)
    length, many = block * blocks, values.shape[0]
    if xp is np:
        return np.add.reduceat(values, np.arange(0, values.shape[-1], length), axis=-1).reshape(many, -1).T
    whole = xp.pad(values, ((0, 0), (0, 0), (0, -values.shape[-1] % length)))
    return whole.reshape(many, -1, length).sum(-1).T
