"""One vector before all recordings: innovations and their derivatives, and what the fits make of them.

Simulation and products are compiled apart: the first is long and there is one for each structure, the second is short
and the same for all structures with as many parameters.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from frictionjax.estimation.data.batch import rows_of
from frictionjax.estimation.evidence.residuals import block_power
from frictionjax.estimation.objective.setting import Setting, all_columns, compact_jacobian
from frictionjax.estimation.parameters import Free

CLUSTER_BLOCKS = 10
"""Blocks in a cluster (0.5 s): longer than the memory of the observer and of most unmodelled forces."""
_SQUARED = 1e150  # the square of more is no number


class Seen(eqx.Module):
    """Innovations at one vector, and their derivatives.

    **Attributes:** `e` (standardised innovations, `(r, n)`), their mean square in each block, `power` `(r, b)`, the
    `columns` of the `compact_jacobian` `(p + 1, r, n)`, and the blocks in which those are `sound` `(r, b)`.
    """

    e: Float[Array, "r n"]
    power: Float[Array, "r b"]
    columns: Float[Array, "p1 r n"]
    sound: Bool[Array, "r b"]

    def of_recordings(self, rows: Int[np.ndarray, " k"]) -> "Seen":
        """The same of the recordings `rows` alone."""
        e, power, sound = rows_of((self.e, self.power, self.sound), rows)
        return Seen(e, power, jnp.asarray(np.asarray(self.columns)[:, rows]), sound)


class Look(eqx.Module):
    """What a descent sees of one vector.

    **Attributes:** `power` (mean square of the standardised innovations in each block, `(r, b)`), `cost` (at the knee,
    of the fitted recordings and the prior), `gradient` `(q,)`, `hessian` `(q, q)` (Gauss-Newton, with the prior), and
    `clusters`, the gradient of each cluster of 0.5 s without the prior, `(c, q)`.
    """

    power: Float[Array, "r b"]
    cost: Float[Array, ""]
    gradient: Float[Array, " q"]
    hessian: Float[Array, "q q"]
    clusters: Float[Array, "c q"]


# XLA's next levels compile for longer, and what they make of this loop is no faster.
@eqx.filter_jit(compiler_options={"xla_backend_optimization_level": 1})  # type: ignore[call-overload]
def seen_at(
    layout: tuple[Free, ...], vector: Float[Array, " q"], setting: Setting, most: Float[Array, " r"]
) -> Seen:
    """Innovations and their derivatives at the free `vector`, shape `(q,)`.

    A bristle that yields between two samples, time and again, makes the motion chaotic: its derivatives grow without
    end and say nothing of a finite step, and one such block would outvote all others. No parameter can do more to the
    motion than to make the whole of it another: beyond `most`, shape `(r,)`, a block is not `sound`. A starting
    deflection can: all that it might be is far more than a machine in stick moves.
    """
    e, columns = compact_jacobian(layout, vector, setting)
    # Each by itself: a maximum may pass over what is not a number.
    told = jnp.all(jnp.abs(columns[: len(layout)]) <= most[None, :, None], axis=0)
    told = told & (jnp.abs(columns[-1]) < _SQUARED)
    sound = jnp.all(told.reshape(told.shape[0], -1, setting.batch.block), axis=-1)
    return Seen(e, block_power(e, setting.batch), columns, sound)


def look_of(
    seen: Seen, vector: Float[Array, " q"], setting: Setting, fitted: Float[Array, " r"], knee: float
) -> Look:
    """The robust cost near `vector` with the Cauchy knee at the power `knee`; `fitted` is 1 for the recordings that
    parameters see, 0 for others, shape `(r,)`."""
    masks, prior = (setting.weight, setting.batch.valid), (setting.start, setting.prior)
    return _look(seen, vector, masks, prior, fitted, np.asarray(knee, dtype=float), setting.batch.block)


@eqx.filter_jit
def _look(seen: Seen, vector, masks, prior, fitted, knee, block: int) -> Look:
    (mask, valid), (start, stiff) = masks, prior
    count, recordings = seen.columns.shape[0] - 1, fitted.shape[0]
    root = _root(seen, mask, knee, block)
    tall, own = _weighed(seen, root, fitted, block)
    # As few passes through the columns as there can be: they are what takes the time beside the simulation. A starting
    # deflection sees its own recording only.
    flat = tall.reshape(count, -1)
    cross, beside = jnp.sum(tall * own[None], axis=-1), jnp.sum(own * own, axis=-1)
    hessian = jnp.block([[flat @ flat.T, cross], [cross.T, jnp.diag(beside)]])
    errors = root * seen.e
    sums = sum_clusters(tall * errors[None], block).reshape(recordings, -1, count)
    mine = sum_clusters((own * errors)[None], block).reshape(recordings, -1, 1)
    clusters = jnp.concatenate([sums, jnp.eye(recordings)[:, None, :] * mine], axis=-1)
    clusters = clusters.reshape(-1, count + recordings)
    off = (vector - start) * stiff
    scored = jnp.sum((mask * valid).reshape(recordings, -1, block), axis=-1)
    cost = jnp.sum(fitted * (_cost(seen.power, knee, scored) + 0.5 * off[count:] ** 2))
    gradient = jnp.sum(clusters, axis=0) + off * stiff
    return Look(
        seen.power, cost + 0.5 * jnp.sum(off[:count] ** 2), gradient, hessian + jnp.diag(stiff**2), clusters
    )


def _root(seen: Seen, mask, knee, block: int):
    """Root of the weight of each sample, shape `(r, n)`."""
    return jnp.sqrt(_each(1.0 / (seen.power + knee), mask.shape[-1], block) * mask)


def _each(blocks, samples: int, block: int):
    """A value of each block for each of its samples."""
    return jnp.repeat(blocks, block, axis=-1, total_repeat_length=samples)


def _told(seen: Seen, block: int):
    """The columns, 0 in the blocks in which they are not sound, shape `(p + 1, r, n)`."""
    return jnp.where(_each(seen.sound, seen.e.shape[-1], block)[None], seen.columns, 0.0)


def _weighed(seen: Seen, root, fitted, block: int):
    """Weighed columns of the parameters, which see the fitted recordings only, and that of the starting deflections:
    `(p, r, n)` and `(r, n)`."""
    columns = _told(seen, block)
    return columns[:-1] * (root * fitted[:, None])[None], columns[-1] * root


def _cost(power, knee, count):
    """Cauchy cost of each recording with the knee at the power `knee`, of blocks of `count` samples, shape `(r,)`."""
    return 0.5 * jnp.sum(count * jnp.log((power + knee) / (2.0 * knee)), axis=1)


@eqx.filter_jit
def cluster_curvatures(
    seen: Seen, mask: Float[Array, "r n"], fitted: Float[Array, " r"], block: int
) -> Float[Array, "r c k k"]:
    """Parts of the Gauss-Newton matrix, with the knee at the noise, by cluster in the parameters and the own starting
    deflection; `mask` is the weight of each sample."""
    tall, own = _weighed(seen, _root(seen, mask, 1.0, block), fitted, block)
    length = block * CLUSTER_BLOCKS
    short = ((0, 0), (0, 0), (0, -mask.shape[-1] % length))
    columns = jnp.pad(jnp.concatenate([tall, own[None]]), short)
    columns = columns.reshape(*columns.shape[:2], -1, length)
    return jnp.einsum("irct,jrct->rcij", columns, columns)


@eqx.filter_jit
def told_columns(seen: Seen, block: int) -> Float[Array, "q r n"]:
    """The Jacobian by all free coordinates, 0 in the blocks in which it is not sound."""
    return all_columns(_told(seen, block))


def sum_clusters(values: Float[Array, "q r n"], block: int) -> Float[Array, "c q"]:
    """Sums of `values` over clusters of 0.5 s (`CLUSTER_BLOCKS` blocks of `block` samples)."""
    length = block * CLUSTER_BLOCKS
    padded = jnp.pad(values, ((0, 0), (0, 0), (0, -values.shape[-1] % length)))
    return padded.reshape(values.shape[0], -1, length).sum(-1).T
