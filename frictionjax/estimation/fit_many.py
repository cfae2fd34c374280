"""`fit_many`: one model fitted to many data sets of one shape at once: Monte Carlo studies and the bootstrap.

The descents of `fit` (`settle`, `refine`), on every core at once.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.core import InputError, Progress, reporting, require_x64
from frictionjax.core.arrays import Numbers
from frictionjax.estimation.constraints import resolve
from frictionjax.estimation.data.batch import Batch, make_batch
from frictionjax.estimation.data.given import keeps_inertia, plant_of, require_agreement
from frictionjax.estimation.descent.replicated import Found, Sets, fitted
from frictionjax.estimation.evidence import Observed, observed
from frictionjax.estimation.objective.loss import Gaussian
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import FAST_BANDWIDTH
from frictionjax.estimation.parameters import Free, pack, weak_prior
from frictionjax.estimation.scales import plant_scales
from frictionjax.estimation.start.driven import starting_values
from frictionjax.estimation.uncertainty import standard_errors
from frictionjax.physics import Drive
from frictionjax.recordings import Recording

_OUTLYING = 6.0  # robust standard deviations of all sets
# One data set at a time fills the vector units of a core with its tangents; four at once were a fifth slower each, as
# they no longer fit its nearest cache (three-regime experiment).
_LANES = 1


class Replicas(eqx.Module):
    """Fits of `d` data sets.

    **Attributes:**

    - `names`: labels of the p free parameters.
    - `values`, `stderr`: in physical units, shape `(d, p)`; `stderr` as in `FitResult.stderr`: infinite where the
        data do not determine a parameter.
    - `stderr_white`: by the inverse information alone, shape `(d, p)`.
    - `position`, `push`: noise of the measured position and unmeasured force (as in `RecordingNoise`) of each
        recording, shape `(d, r)`.
    - `cost`: minus the log-posterior, but for a constant, shape `(d,)`; NaN where a fit is not finite.
    - `moved`: how far the last round still moved the vector, at most, in standard deviations of a parameter were all
        others known, shape `(d,)`.
    - `converged`: whether neither noise nor parameters change any more, shape `(d,)`.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, "d p"]
    stderr: Float[np.ndarray, "d p"]
    stderr_white: Float[np.ndarray, "d p"]
    position: Float[np.ndarray, "d r"]
    push: Float[np.ndarray, "d r"]
    cost: Float[np.ndarray, " d"]
    moved: Float[np.ndarray, " d"]
    converged: Bool[np.ndarray, " d"]

    def of(self, name: str) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
        """Values and standard errors of the parameter `name`, shape `(d,)` each."""
        place = self.names.index(name)
        return self.values[:, place], self.stderr[:, place]


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
    progress: Progress | bool = True,
) -> Replicas:
    """Fit `drive` to each of `sets`: the estimator of `fit`, many at once, on every core.

    All sets have the same number of recordings, with the same lengths and sample rates: they share one compiled
    program. `Replicas.converged`: which fits have converged.

    **Arguments:**

    - `drive`: start for all, or one for each set.
    - `sets`: data sets, each a sequence of force-driven recordings.
    - `free`, `fixed`, `ties`, `priors`, `encoder_step`, `substeps`: as in `fit`.
    - `settle`: bring down a robust cost first; False for starts that are near, as in a bootstrap.
    - `own_starts`: the `starting_values` of the first set are a second start for all, taken where their robust cost is
        lower; and sets whose result is unlike that of the others are fitted again from each start, and from the median
        of the others. The likelihood decides.
    - `progress`: called as fits are done; True: a bar on a terminal and in a notebook; False: nothing.

    **Returns:**

    The `Replicas`.

    **Raises:**

    `PrecisionError` unless JAX computes in float64; `InputError` when there is no set, they differ in shape, or `drive`
    contradicts the case of the recordings.
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
    plant = plant_of([recording for recordings in sets for recording in recordings])
    known_inertia = keeps_inertia(plant, None, {*(free or ()), *(priors or {}), *(ties or {})})
    for one in starts:
        constant = "motor_constant" not in (free or ())
        require_agreement(one, plant, motor_constant=constant, inertia=known_inertia)
    if known_inertia and "J" not in fixed:
        fixed = (*fixed, "J")
    if encoder_step is None and plant is not None:
        encoder_step = plant.encoder_step
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
    posterior = Posterior(
        constraints,
        template,
        vectors[0],
        prior,
        (evidence,),
        (weight,),
        Gaussian(),
        (jnp.ones(rows),),
        (None,),
    )
    whole = Sets(
        *(
            np.stack([np.asarray(getattr(b, name)) for b in batches])
            for name in ("u", "x", "noise", "x0", "v0")
        ),
        vector=np.stack([np.asarray(v) for v in vectors]),
        other=_others(vectors, constraints.layout, template, sets[0] if own_starts and settle else ()),
    )

    with reporting(progress) as report:

        def run(sets: Sets) -> Found:
            return _on_all(posterior, sets, int(substeps), bool(settle), report)

        found = run(whole)
        if settle and own_starts:
            # The start of lower cost may lead to a wrong minimum: such sets are fitted again from each of the two, and
            # from the median of the others.
            for retry in ("vector", "other", None):
                places = _doubtful(found)
                if not places.size:
                    break
                one = jax.tree.map(lambda leaf, places=places: leaf[places], whole)
                if retry:
                    start = getattr(one, retry)
                else:
                    finite = found.vector[np.all(np.isfinite(found.vector), axis=1)]
                    if not finite.size:
                        break
                    start = np.tile(np.median(finite, axis=0), (places.size, 1))
                again = run(eqx.tree_at(lambda w: (w.vector, w.other), one, (start, start)))
                _keep_better(found, again, places)
    return _replicas(found, posterior)


def _on_all(posterior: Posterior, sets: Sets, substeps: int, settle: bool, progress: Progress) -> Found:
    """The fits of all `sets`, one after the other on each device: a thread for each feeds it."""
    devices = jax.local_devices()
    # A GPU takes all of its share at once.
    lanes = _LANES if devices[0].platform == "cpu" else -(-sets.x.shape[0] // len(devices))
    count, done = sets.x.shape[0], 0
    idle: SimpleQueue = SimpleQueue()
    for device in devices:
        idle.put(device)

    def run(first: int) -> Found:
        # The last sets are filled up with the very last, so that all share one compiled program.
        taken = np.minimum(np.arange(first, first + lanes), count - 1)
        some = jax.tree.map(lambda leaf: leaf[taken], sets)
        device = idle.get()
        try:
            with jax.default_device(device):
                there = jax.device_put((posterior, some), device)
                found = fitted(*there, substeps=substeps, first_descent=settle)
        finally:
            idle.put(device)
        return jax.tree.map(lambda leaf: leaf[: count - first], found)

    parts = []
    with ThreadPoolExecutor(len(devices)) as threads:
        for part in threads.map(run, range(0, count, lanes)):
            parts.append(part)
            done += part.cost.size
            progress("fits", done / count)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _outside(values: Float[np.ndarray, " d"]) -> Bool[np.ndarray, " d"]:
    """Which of `values` are far from most, or not finite."""
    finite = np.isfinite(values)
    if not np.any(finite):
        return ~finite
    middle = np.median(values[finite])
    spread = 1.4826 * np.median(np.abs(values[finite] - middle))
    return ~(np.abs(values - middle) <= _OUTLYING * spread + 1e-12 * np.abs(middle))


def _doubtful(found: Found) -> Int[np.ndarray, " k"]:
    """Places of the sets whose fit may be at a wrong minimum: its cost, or a parameter, is far from those of the
    others, or it has not converged. Fitting a set again can only lower its cost."""
    unlike = [_outside(found.cost), *(_outside(column) for column in found.values.T), ~found.converged]
    return np.flatnonzero(np.any(unlike, axis=0))


def _keep_better(found: Found, again: Found, places: Int[np.ndarray, " k"]) -> None:
    """Put fits made `again` into their `places` among those `found`, where their cost is lower."""
    better = (again.cost < found.cost[places]) | ~np.isfinite(found.cost[places])
    for kept, new in zip(jax.tree.leaves(found), jax.tree.leaves(again), strict=True):
        kept[places[better]] = new[better]


def _others(
    vectors: Sequence[Float[Numbers, " q"]],
    layout: tuple[Free, ...],
    template: Drive,
    first: Sequence[Recording],
) -> Float[np.ndarray, "d q"]:
    """A second start for each set: the starting values of the `first` one, or the same again."""
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


def _replicas(found: Found, posterior: Posterior) -> Replicas:
    values, cost, layout = found.values, found.cost, posterior.constraints.layout
    prior = np.asarray(posterior.prior)
    known = [
        standard_errors(slopes, hessian, clustered, prior, at_end)
        for slopes, hessian, clustered, at_end in zip(
            found.slopes, found.hessian, found.covariance, found.at_end, strict=True
        )
    ]
    usable: Bool[np.ndarray, " d"] = np.all(np.isfinite(values), axis=1)
    return Replicas(
        tuple(one.label for one in layout),
        values,
        np.stack([one.stderr for one in known]),
        np.sqrt(np.stack([np.diag(one.white) for one in known])),
        np.asarray(found.noise.position),
        np.asarray(found.noise.push),
        np.where(usable, cost, np.nan),
        found.moved,
        found.converged,
    )
