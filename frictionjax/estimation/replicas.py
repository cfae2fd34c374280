"""`fit_many`: one model fitted to many data sets of one shape at once: Monte Carlo studies and the bootstrap.

The way of `fit`, with the number of rounds fixed beforehand, so that all data sets take the same steps side by side.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from frictionjax.core import InputError, Progress, require_x64, silent
from frictionjax.estimation.batch import Batch, make_batch
from frictionjax.estimation.constraints import resolve
from frictionjax.estimation.evidence import Observed, filtered, observed, scored_from_the_start
from frictionjax.estimation.least_squares import STRIDE, equal_curvature, levenberg_marquardt
from frictionjax.estimation.loss import Cauchy, Gaussian
from frictionjax.estimation.parameters import pack, part_of
from frictionjax.estimation.posterior import Posterior, near_of
from frictionjax.estimation.problem import FAST_BANDWIDTH, weak_prior
from frictionjax.estimation.refine import AT_FIRST, CLOSE, LIKELY, LONG, NEXT
from frictionjax.estimation.result import CLUSTER, honest_covariance, inverse_of
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start import starting_values
from frictionjax.physics import Drive
from frictionjax.recordings import Recording

_QUANTILE = 0.8  # of the block powers: the knee of the robust loss, before it is at the noise
_STEPS = 5  # of Levenberg-Marquardt in a round; the first only looks around
_ROUNDS = (AT_FIRST, LIKELY, *(NEXT,) * 5)  # candidates for the noise, round by round
_FAR = 8.0  # robust standard deviations of the costs of all sets
_LANES = 4  # data sets side by side on one core: enough to fill its vector units


class Replicas(eqx.Module):
    """Fits of `d` data sets.

    **Attributes:**

    - `names`: labels of the p free parameters.
    - `values`, `stderr`: in physical units, shape `(d, p)`; `stderr` as in `FitResult.covariance`.
    - `stderr_white`: by the inverse information alone, shape `(d, p)`.
    - `position`, `push`: noise of each recording, shape `(d, r)`.
    - `cost`: minus the log-posterior, but for a constant, shape `(d,)`; NaN where a fit was lost.
    - `moved`: how far the last round still moved the vector, at most, in standard deviations of a parameter were all
        others known, shape `(d,)`.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, "d p"]
    stderr: Float[np.ndarray, "d p"]
    stderr_white: Float[np.ndarray, "d p"]
    position: Float[np.ndarray, "d r"]
    push: Float[np.ndarray, "d r"]
    cost: Float[np.ndarray, " d"]
    moved: Float[np.ndarray, " d"]

    def of(self, name: str) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
        """Values and standard errors of the parameter `name`, shape `(d,)` each."""
        place = self.names.index(name)
        return self.values[:, place], self.stderr[:, place]


class _Sets(eqx.Module):
    """What differs from data set to data set; shapes `(d, ...)`."""

    u: Float[Array | np.ndarray, "d r n"]
    x: Float[Array | np.ndarray, "d r n"]
    noise: Float[Array | np.ndarray, "d r"]
    x0: Float[Array | np.ndarray, "d r"]
    v0: Float[Array | np.ndarray, "d r"]
    vector: Float[Array | np.ndarray, "d q"]
    other: Float[Array | np.ndarray, "d q"]


def _batch_of(posterior: Posterior) -> Batch:
    """The recordings of `posterior`, its only evidence."""
    (seen,) = posterior.evidence
    if not isinstance(seen, Observed):
        raise TypeError("Many fits at once are for positions.")
    return seen.batch


def _with(posterior: Posterior, one: _Sets) -> Posterior:
    """The `posterior` with the numbers of one data set."""
    batch = eqx.tree_at(
        lambda b: (b.u, b.x, b.noise, b.x0, b.v0),
        _batch_of(posterior),
        (one.u, one.x, one.noise, one.x0, one.v0),
    )
    return eqx.tree_at(lambda p: (p.evidence[0].batch, p.start), posterior, (batch, one.vector))


def _powers(posterior: Posterior, vector):
    """Mean square of each block in noise levels; large where a run is not finite."""
    e = posterior.errors(vector, 0)
    power = jnp.sum(e * e, axis=1) / jnp.maximum(posterior.evidence[0].count, 1.0)
    return jnp.where(jnp.isfinite(power), power, 1e12)


def _better(posterior: Posterior, vector, other):
    """The start, of two, with the lower robust cost."""
    cost, rival = (
        jnp.sum(posterior.evidence[0].count * jnp.log1p(_powers(posterior, v))) for v in (vector, other)
    )
    return jnp.where(cost <= rival, vector, other)


def _settled(posterior: Posterior, vector):
    seen = posterior.evidence[0]
    unit = equal_curvature(posterior, vector)
    power = jnp.where(seen.count > 0, _powers(posterior, vector), jnp.nan)
    for knee in (jnp.maximum(jnp.nanquantile(power, _QUANTILE), 1.0), jnp.ones(()), jnp.ones(())):
        there = eqx.tree_at(lambda p: p.loss, posterior, Cauchy(knee))
        vector = posterior.within(levenberg_marquardt(there, vector, unit, _STEPS).vector)
    return vector


def _refined(posterior: Posterior, vector, substeps: int, settled: bool):
    """The bottom of the valley, what its noise is, and how far the last round moved."""
    batch = scored_from_the_start(_batch_of(posterior))
    known = jnp.zeros(batch.x.shape[0], dtype=bool)

    # The rounds stand one after the other: in a loop of their own, the loops inside would copy what they carry.
    unit = best = None
    for parts in _ROUNDS if settled else _ROUNDS[1:]:
        drive, z0 = posterior.drive_of(vector), posterior.deflections_of(vector, 0)
        if best is None or parts is not NEXT:
            best = drive.friction.Fc / batch.noise
        ratio = best[:, None] * parts[None]
        positions, noise = filtered(drive, z0, batch, ratio, known, substeps)
        best = noise.best
        posterior = eqx.tree_at(lambda p: p.evidence, posterior, (positions,))
        if unit is None:
            unit = LONG * equal_curvature(posterior, vector)
        end = levenberg_marquardt(posterior, vector, unit, _STEPS, tolerance=CLOSE)
        far = jnp.max(jnp.abs(end.vector - vector) / end.unit) * STRIDE
        vector, unit = posterior.within(end.vector), LONG * end.unit
    return posterior, vector, noise, end.cost + posterior.log_deviation, far


def _one(posterior: Posterior, one: _Sets, substeps: int, settle: bool):
    """All that is kept of one data set."""
    posterior, vector = _with(posterior, one), jnp.asarray(one.vector)
    if settle:
        vector = _settled(posterior, _better(posterior, vector, one.other))
        posterior = eqx.tree_at(lambda p: p.start, posterior, vector)
    posterior, vector, noise, cost, moved = _refined(posterior, vector, substeps, settle)
    near = near_of(posterior, vector)
    blocks = near.gradients[0].reshape(one.x.shape[0], -1, vector.shape[0])
    blocks = jnp.pad(blocks, ((0, 0), (0, -blocks.shape[1] % CLUSTER), (0, 0)))
    sums = blocks.reshape(-1, CLUSTER, vector.shape[0]).sum(1)

    def values(point):
        drive = posterior.drive_of(point)
        return jnp.stack([part_of(drive, free.path) for free in posterior.constraints.layout])

    return values(vector), jax.jacfwd(values)(vector), near.hessian, sums.T @ sums, noise, cost, moved


@eqx.filter_jit
def _in_turn(posterior: Posterior, sets: _Sets, substeps: int, settle: bool):
    """All `sets`, a few at a time."""
    return jax.lax.map(lambda one: _one(posterior, one, substeps, settle), sets, batch_size=_LANES)


def _on_all(posterior: Posterior, sets: _Sets, substeps: int, settle: bool, devices: tuple):
    """`_in_turn` on every device, for its share of the sets: a thread for each feeds it."""
    share = sets.x.shape[0] // len(devices)

    def run(number: int):
        some = jax.tree.map(lambda leaf: leaf[number * share : (number + 1) * share], sets)
        there = jax.device_put((posterior, some), devices[number])
        return jax.block_until_ready(_in_turn(there[0], there[1], substeps, settle))

    with ThreadPoolExecutor(len(devices)) as threads:
        parts = list(threads.map(run, range(len(devices))))
    return jax.tree.map(lambda *leaves: np.concatenate([np.asarray(leaf) for leaf in leaves]), *parts)


def fit_many(
    drive: Drive | Sequence[Drive],
    sets: Sequence[Sequence[Recording]],
    *,
    free: Sequence[str] | None = None,
    fixed: Sequence[str] = (),
    ties: Mapping[str, tuple[str, float]] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    encoder_step: float | None = None,
    substeps: int = 2,
    settle: bool = True,
    own_starts: bool = True,
    piece: int = 128,
    progress: Progress = silent,
) -> Replicas:
    """Fit `drive` to each of `sets`: the estimator of `fit`, many at once, on every core.

    All sets have the same number of recordings, with the same lengths and sample rates: they share one compiled
    program. The rounds are as many for each; `Replicas.moved` says whether they were enough.

    **Arguments:**

    - `drive`: start for all, or one for each set.
    - `sets`: data sets, each a sequence of force-driven recordings.
    - `free`, `fixed`, `ties`, `priors`, `encoder_step`, `substeps`: as in `fit`.
    - `settle`: go down a robust cost first; False for starts that are near, as in a bootstrap.
    - `own_starts`: what `starting_values` reads off the first set is a second start for all, taken where it looks
        better.
    - `piece`: so many sets are handed to the devices at a time.
    - `progress`: called as pieces are done.

    **Returns:**

    The `Replicas`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` when there is no set, or they differ in shape.
    """
    require_x64()
    count = len(sets)
    if not count:
        raise InputError("there is no data set", place="`sets`", cure="Give at least one list of recordings.")
    starts = (drive,) * count if isinstance(drive, Drive) else tuple(drive)
    if len(starts) != count:
        raise InputError(
            f"{len(starts)} starts for {count} sets", place="`drive`", cure="Give one, or one each."
        )
    batches = [make_batch(tuple(recordings), encoder_step=encoder_step) for recordings in sets]
    _check(batches)
    template = starts[0]
    constraints = resolve(
        template,
        float(np.min(np.asarray(batches[0].dt))),
        plant_scales(template, batches[0]),
        free=free,
        fixed=fixed,
        ties=ties or {},
        bounds={},
        priors=priors or {},
    )
    rows = batches[0].x.shape[0]
    vectors = [jnp.concatenate([pack(constraints.layout, one), jnp.zeros(rows)]) for one in starts]
    evidence: Observed = observed(batches[0], FAST_BANDWIDTH)
    weight = jnp.ones(evidence.count.shape[0])
    prior = weak_prior(constraints.layout, rows)
    posterior = Posterior(constraints, template, vectors[0], prior, (evidence,), (weight,), Gaussian())
    devices = tuple(jax.local_devices(backend=jax.default_backend()))
    whole = _Sets(
        *(
            np.stack([np.asarray(getattr(b, name)) for b in batches])
            for name in ("u", "x", "noise", "x0", "v0")
        ),
        vector=np.stack([np.asarray(v) for v in vectors]),
        other=_others(vectors, constraints.layout, template, sets[0] if own_starts and settle else ()),
    )
    piece = -(-min(piece, count) // len(devices)) * len(devices)

    def run(sets: _Sets):
        return _in_pieces(posterior, sets, int(substeps), bool(settle), devices, piece, progress)

    found = run(whole)
    for retry in ("vector", "other"):
        places = _doubtful(found)
        if not (settle and own_starts and places.size):
            break
        # A start that looked better may lead into a wrong valley: those sets are tried from each of the two.
        one = jax.tree.map(lambda leaf, places=places: leaf[places], whole)
        start = getattr(one, retry)
        again = run(eqx.tree_at(lambda w: (w.vector, w.other), one, (start, start)))
        better = ~(found[5][places] <= again[5])
        for kept, new in zip(jax.tree.leaves(found), jax.tree.leaves(again), strict=True):
            kept[places[better]] = new[better]
    return _replicas(found, posterior, batches[0])


def _in_pieces(posterior: Posterior, sets: _Sets, substeps: int, settle: bool, devices, piece: int, progress):
    """All that is kept of all `sets`, as numpy arrays."""
    count, found = sets.x.shape[0], []
    for first in range(0, count, piece):
        # The last piece is filled up with its last set, so that all pieces share one compiled program.
        taken = np.minimum(np.arange(first, first + piece), count - 1)
        some = jax.tree.map(lambda leaf, taken=taken: leaf[taken], sets)
        kept = min(piece, count - first)
        parts = _on_all(posterior, some, substeps, settle, devices)
        found.append(jax.tree.map(lambda leaf, kept=kept: leaf[:kept], parts))
        progress("fits", min(first + piece, count) / count)
    return jax.tree.map(lambda *parts: np.concatenate(parts), *found)


def _doubtful(found) -> Int[np.ndarray, " k"]:
    """Places of the sets whose fit may be in a wrong valley: its likelihood is far below that of the others."""
    cost = np.where(np.isfinite(found[5]), found[5], np.inf)
    middle = float(np.median(cost))
    spread = 1.4826 * float(np.median(np.abs(cost - middle))) if np.isfinite(middle) else 0.0
    return np.flatnonzero(~(cost <= middle + _FAR * (spread + 1.0)))


def _others(vectors, layout, template: Drive, first: Sequence[Recording]) -> Float[np.ndarray, "d q"]:
    """A second start for each set: read off the recordings of the `first`, or the same again."""
    others = np.stack([np.asarray(vector) for vector in vectors])
    if first:
        own = starting_values(tuple(first), motor_constant=float(template.motor_constant)).drives[-1]
        drive = eqx.tree_at(lambda d: (d.J, d.friction), template, (own.J, own.friction))
        others[:, : len(layout)] = np.asarray(pack(layout, drive))
    return others


def _check(batches: list[Batch]) -> None:
    for number, batch in enumerate(batches):
        same = np.array_equal(batch.lengths, batches[0].lengths) and np.allclose(batch.dt, batches[0].dt)
        if not same:
            raise InputError(
                f"set {number} has recordings of {batch.lengths.tolist()} samples, "
                f"the first {batches[0].lengths.tolist()}",
                place="`sets`",
                cure="Give sets of one shape and sample rate, or fit them one by one with `fit`.",
            )


def _replicas(found, posterior: Posterior, batch: Batch) -> Replicas:
    values, slopes, hessians, meats, noise, cost, moved = found
    count, layout = values.shape[0], posterior.constraints.layout
    blocks = np.asarray(batch.block_count).reshape(batch.x.shape[0], -1)
    clusters = int(sum(-(-np.count_nonzero(row) // CLUSTER) for row in blocks))
    white = np.full(values.shape, np.nan)
    honest = np.full(values.shape, np.nan)
    for i in range(count):
        if np.all(np.isfinite(hessians[i])) and np.all(np.isfinite(meats[i])):
            inverse = inverse_of(hessians[i])
            white[i] = np.sqrt(np.diag(slopes[i] @ inverse @ slopes[i].T))
            covariance = honest_covariance(inverse, meats[i], clusters, slopes[i])
            honest[i] = np.sqrt(np.diag(covariance))
    usable: Bool[np.ndarray, " d"] = np.all(np.isfinite(values), axis=1)
    return Replicas(
        tuple(one.label for one in layout),
        values,
        honest,
        white,
        noise.position,
        noise.push,
        np.where(usable, cost, np.nan),
        moved,
    )
