"""A cost near one vector: value, gradient and Gauss-Newton matrix, and what its parts are made of."""

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from frictionjax.core.arrays import Numbers, known, numpy_or_jax
from frictionjax.core.plain_methods import PlainMethods
from frictionjax.estimation.data.batch import CLUSTER, rows_of
from frictionjax.estimation.evidence.power import sum_clusters
from frictionjax.estimation.objective.loss import AbstractLoss


class Quadratic(PlainMethods, eqx.Module):
    """A cost near one vector.

    **Attributes:** `cost`, its `gradient`, shape `(q,)`, and a Gauss-Newton `hessian`, shape `(q, q)`; for each
    evidence `clusters`, the gradients of its clusters of 0.5 s without prior, shape `(c, q)`, and `powers`, the mean
    square of its standardised errors in each block, shape `(r, b)`.
    """

    cost: Float[Numbers, ""]
    gradient: Float[Numbers, " q"]
    hessian: Float[Numbers, "q q"]
    clusters: tuple[Float[Numbers, "_ q"], ...] = ()
    powers: tuple[Float[Numbers, "_ _"], ...] = ()

    def __add__(self, other: "Quadratic") -> "Quadratic":
        """Both costs together."""
        return Quadratic(
            self.cost + other.cost,
            self.gradient + other.gradient,
            self.hessian + other.hessian,
            self.clusters + other.clusters,
            self.powers + other.powers,
        )


class AbstractObjective(PlainMethods, eqx.Module):
    """A cost that a descent can bring down."""

    @abstractmethod
    def quadratic(self, vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost near `vector`, shape `(q,)`; inside compiled functions."""

    def near(self, vector: Float[Numbers, " q"]) -> Quadratic:
        """The cost near `vector`, shape `(q,)`, in arrays of NumPy."""
        return jax.device_get(_near(self, jnp.asarray(vector)))


@eqx.filter_jit
def _near(objective: AbstractObjective, vector: Float[Numbers, " q"]) -> Quadratic:
    return objective.quadratic(vector)


class Evaluation(PlainMethods, eqx.Module):
    """Errors of one evidence at one vector, and their derivatives. Evidence without starting deflections is one row.

    **Attributes:** `e` (standardised errors, `(r, n)`), their mean square in each block, `power` `(r, b)`, the
    `columns` of their derivatives by the p parameters and, last, of each row by its own starting deflection, where
    it has one, `(k, r, n)`, and the blocks in which those are `sound` `(r, b)`.
    """

    e: Float[Numbers, "r n"]
    power: Float[Numbers, "r b"]
    columns: Float[Numbers, "k r n"]
    sound: Bool[Numbers, "r b"]

    @property
    def block(self) -> int:
        """Samples in a block."""
        return self.e.shape[1] // self.power.shape[1]

    def of_recordings(self, rows: Int[np.ndarray, " k"]) -> "Evaluation":
        """The same of the recordings `rows` alone."""
        e, power, sound = rows_of((self.e, self.power, self.sound), rows)
        return Evaluation(e, power, np.asarray(self.columns)[:, rows], sound)

    def sound_columns(self) -> Float[Numbers, "k r n"]:
        """The `columns`, 0 in the blocks in which they are not sound."""
        xp, (sound, columns) = known(self.sound, self.columns)
        if xp is np and np.all(sound):
            return columns
        return xp.where(_each(sound, self.block)[None], columns, 0.0)


class EvidenceCoordinates(NamedTuple):
    """Where the coordinates of one evidence stand in the free vector: the number of `parameters`, the `first` of its
    starting deflections, how many `rows` there are, and the `size` of the vector."""

    parameters: int
    first: int
    rows: int
    size: int

    @property
    def blocks_in_cluster(self) -> int:
        """Blocks in a cluster of the covariance: evidence without recordings has one number in a block, and no time."""
        return CLUSTER if self.rows else 1

    def spread(self, own: Float[Numbers, "m k"]) -> Float[Numbers, "m size"]:
        """Columns of the parameters and of the `own` deflections among those of the whole vector; the others are 0."""
        xp = numpy_or_jax(own)
        before = xp.zeros((own.shape[0], self.first - self.parameters))
        after = xp.zeros((own.shape[0], self.size - self.first - self.rows))
        return xp.concatenate([own[:, : self.parameters], before, own[:, self.parameters :], after], axis=1)


def quadratic_of(
    evaluation: Evaluation,
    count: Float[Numbers, " b"],
    loss: AbstractLoss,
    weight: Float[Numbers, " b"],
    place: EvidenceCoordinates,
    fitted: Float[Numbers, " r"],
) -> Quadratic:
    """Cost 1/2 sum of `count` rho(mean square) over blocks of standardised errors, with exact gradient.

    The matrix is that of re-weighted least squares: the curvature of a robust loss is left out. With it steps are
    longer, and from starts 30 % off they ran into minima at the ends of the range.

    **Arguments:**

    - `evaluation`: errors, 0 where not scored, and their derivatives.
    - `count`: scored samples in each block, shape `(b,)`.
    - `loss`: an `AbstractLoss`.
    - `weight`: how much each block's cost counts, shape `(b,)`.
    - `place`: of its coordinates in the free vector.
    - `fitted`: 1 for fitted rows, 0 for held-out ones, shape `(r,)`.
    """
    xp, given = known(evaluation, count, loss, weight, fitted)
    evaluation, count, loss, weight, fitted = given
    blocks, many = evaluation.power.shape, place.parameters
    root = xp.sqrt(_each(loss.weight(evaluation.power) * weight.reshape(blocks), evaluation.block))
    tall, own = _weighed(evaluation, root, place, fitted)
    errors = root * evaluation.e
    # As few passes through the columns as there can be: they are what takes the time beside the simulation.
    flat = tall.reshape(many, -1)
    hessian = flat @ flat.T
    clusters = sum_clusters(tall * errors[None], evaluation.block, place.blocks_in_cluster)
    if place.rows:
        # A starting deflection moves its own recording only.
        cross = xp.sum(tall * own[None], axis=-1)
        alone = xp.diag(xp.sum(own * own, axis=-1))
        hessian = xp.concatenate(
            [xp.concatenate([hessian, cross], axis=1), xp.concatenate([cross.T, alone], axis=1)]
        )
        mine = sum_clusters((own * errors)[None], evaluation.block).reshape(place.rows, -1, 1)
        mine = (xp.eye(place.rows)[:, None, :] * mine).reshape(-1, place.rows)
        clusters = xp.concatenate([clusters, mine], axis=1)
    hessian, clusters = place.spread(place.spread(hessian).T), place.spread(clusters)
    costs = xp.sum((weight * count * loss.cost(evaluation.power.ravel())).reshape(blocks), axis=1)
    gradient = xp.sum(clusters, axis=0)
    return Quadratic(0.5 * xp.sum(fitted * costs), gradient, hessian, (clusters,), (evaluation.power,))


def _each(blocks: Shaped[Numbers, "r b"], block: int) -> Shaped[Numbers, "r n"]:
    """A value of each block, shape `(r, b)`, for each of its samples."""
    return numpy_or_jax(blocks).repeat(blocks, block, axis=-1)


def _weighed(
    evaluation: Evaluation,
    root: Float[Numbers, "r n"],
    place: EvidenceCoordinates,
    fitted: Float[Numbers, " r"],
) -> tuple[Float[Numbers, "p r n"], Float[Numbers, "r n"]]:
    """Weighted columns of the parameters, 0 in held-out rows, and that of the starting deflections."""
    columns = evaluation.sound_columns()
    return columns[: place.parameters] * (root * fitted[:, None])[None], columns[-1] * root


def cluster_curvatures(
    evaluation: Evaluation,
    loss: AbstractLoss,
    weight: Float[Numbers, " b"],
    place: EvidenceCoordinates,
    fitted: Float[Numbers, " r"],
) -> Float[Numbers, "r c k k"]:
    """Parts of the Gauss-Newton matrix by cluster, in the parameters and the own starting deflection of a row; other
    arguments as in `quadratic_of`."""
    xp, (evaluation, loss, weight, fitted) = known(evaluation, loss, weight, fitted)
    scale = _each(loss.weight(evaluation.power) * weight.reshape(evaluation.power.shape), evaluation.block)
    tall, own = _weighed(evaluation, xp.sqrt(scale), place, fitted)
    columns = xp.concatenate([tall, own[None]]) if place.rows else tall
    length = evaluation.block * place.blocks_in_cluster
    columns = xp.pad(columns, ((0, 0), (0, 0), (0, -columns.shape[-1] % length)))
    columns = xp.moveaxis(columns.reshape(*columns.shape[:2], -1, length), 0, 2)
    return columns @ xp.swapaxes(columns, -1, -2)


def spread_out(own: Float[np.ndarray, "r c k k"], place: EvidenceCoordinates) -> Float[np.ndarray, "_ q q"]:
    """Matrices of clusters, in the parameters and the `own` starting deflection, as parts of the whole matrix."""
    many, (recordings, each) = place.parameters, own.shape[:2]
    whole = np.zeros((recordings, each, place.size, place.size))
    for row in range(recordings):
        places = np.append(np.arange(many), place.first + row) if place.rows else np.arange(many)
        whole[row][:, places[:, None], places] = own[row]
    return whole.reshape(-1, *whole.shape[2:])


def all_columns(evaluation: Evaluation) -> Float[Numbers, "q r n"]:
    """The Jacobian by all parameters and starting deflections of one evidence of recordings, 0 in the blocks in which
    it is not sound."""
    xp, columns = numpy_or_jax(evaluation), evaluation.sound_columns()
    own = xp.eye(columns.shape[1])[:, :, None] * columns[-1][None]
    return xp.concatenate([columns[:-1], own])
