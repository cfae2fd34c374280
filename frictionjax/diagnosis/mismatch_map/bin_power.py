"""Power of the innovations in every bin of every axis, and its standard error from clusters of 0.5 s."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.mismatch_map.axes import MapAxis
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.data.batch import CLUSTER


class Tally(eqx.Module):
    """Which samples to sum for each bin and cluster.

    **Attributes:** `bins` (number of the axis, number of its bin), `samples` of each bin, shape `(b,)`; for each
    cluster of each bin, `m` in all, its bin `owner`, its number of samples `size`, and its number `cluster`; `adds`,
    the sparse matrix `(m, r n)` of ones that sums its samples.
    """

    bins: tuple[tuple[int, int], ...] = eqx.field(static=True)
    samples: Int[np.ndarray, " b"]
    owner: Int[np.ndarray, " m"]
    size: Float[np.ndarray, " m"]
    cluster: Int[np.ndarray, " m"]
    adds: csr_array

    def sums(self, squares: Float[np.ndarray, "k r n"]) -> Float[np.ndarray, "m k"]:
        """Sum over each cluster of each bin of `squares`, shape `(k, r, n)`."""
        return self.adds @ squares.reshape(squares.shape[0], -1).T

    def powers(
        self, sums: Float[np.ndarray, "m k"], rule: Rule
    ) -> tuple[Float[np.ndarray, "b k"], Float[np.ndarray, "b k"]]:
        """Mean of each bin, from the `sums`, and its relative standard error from clusters: each of shape `(b, k)`.

        The standard error is that of a ratio of sums, sum of squares over number of samples; 0 where there are too few
        clusters by the `rule`.
        """
        gather = csr_array(
            (np.ones(self.owner.size), (self.owner, np.arange(self.owner.size))),
            shape=(len(self.bins), self.owner.size),
        )
        mean = (gather @ sums) / self.samples[:, None]
        deviation = sums - mean[self.owner] * self.size[:, None]
        clusters = np.bincount(self.owner, minlength=len(self.bins))[:, None]
        spread = np.sqrt(gather @ deviation**2 * clusters / np.maximum(clusters - 1, 1))
        total = np.maximum(mean * self.samples[:, None], 1e-300)
        return mean, np.where(clusters >= rule.place.least_clusters, spread / total, 0.0)


def tally_of(axes: tuple[MapAxis, ...], scene: Scene, rule: Rule) -> Tally:
    """The tally of all bins of the `axes` with enough scored samples of the `scene`, by the `rule`."""
    scored = np.asarray(scene.batch.valid).ravel() > 0
    cluster = clusters_of(scene).ravel()
    width = int(cluster.max()) + 1
    bins, samples, owner, size, which, columns, rows = [], [], [], [], [], [], []
    total = 0
    for number, axis in enumerate(axes):
        index = np.asarray(axis.index).ravel()
        counts = np.bincount(index[scored & (index >= 0)], minlength=len(axis.labels))
        place = np.full(len(axis.labels) + 1, -1)  # the last for samples in no bin
        for k in np.flatnonzero(counts >= rule.place.least_samples).tolist():
            place[k] = len(bins)
            bins.append((number, k))
            samples.append(int(counts[k]))
        inside = np.flatnonzero(scored & (place[index] >= 0))
        keys = place[index[inside]] * width + cluster[inside]
        count = np.bincount(keys)
        used = np.flatnonzero(count)
        owner.append(used // width)
        which.append(used % width)
        size.append(count[used])
        columns.append(inside)
        rows.append(total + (np.cumsum(count > 0) - 1)[keys])
        total += used.size
    column, row = np.concatenate(columns), np.concatenate(rows)
    adds = csr_array((np.ones(column.size, np.float32), (row, column)), shape=(total, scored.size))
    parts = np.concatenate(owner), np.concatenate(size).astype(float), np.concatenate(which)
    return Tally(tuple(bins), np.array(samples, int), *parts, adds)


def clusters_of(scene: Scene) -> Int[np.ndarray, "r n"]:
    """Number of the cluster of 0.5 s of each sample of the `scene`, shape `(r, n)`; no two recordings share one."""
    rows, length = np.asarray(scene.batch.valid).shape
    own = np.arange(length) // (scene.batch.block * CLUSTER)
    return own[None, :] + (int(own[-1]) + 1) * np.arange(rows)[:, None]
