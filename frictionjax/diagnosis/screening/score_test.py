"""Name: every effect tested against the present model, with all base parameters free to absorb it.

For each form of each effect, finite steps of its strength are injected into the present model, as signals along the
motion that it observed; the innovations are regressed on them and on the Jacobian of the present model. The one-step
estimate, effect and base parameters together, is then simulated: what the misfit really gains ranks the candidates (a
linear gain can be a mirage), and the clustered score test gives the p-value. One compiled model serves all effects.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Bool, Float

from frictionjax.core.arrays import Numbers
from frictionjax.diagnosis.effort import Effort
from frictionjax.diagnosis.screening.linearised import BESIDE, Present
from frictionjax.estimation.evidence.power import block_power, sum_clusters
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.robust import extend
from frictionjax.estimation.uncertainty import merged
from frictionjax.physics.effects import AbstractEffect

_T = TypeVar("_T")
_DAMPING = (1.0, 0.4)
LONGEST_STEP = 1.5
_THROWN = 1e4  # rms of a column's finite step over that of the innovations: beyond it a break-away has moved
_NOTHING = 1e-9  # sum of squares of what a whole coordinate does to the standardised innovations


class Trial(eqx.Module):
    """One effect form tested at one value of its nuisances with one finite step.

    **Attributes:** `effect` (name), `form` (the effect at zero strength), `posterior`, `vector` (the best one-step
    vector), `gain` (drop of the misfit when that vector is simulated), `linear_gain` (drop promised by the regression),
    `p_value` (clustered score test), `one_step` and `detectable` (strength name -> one-step estimate, smallest
    detectable size, in the strength's unit); `shown` (power per sample of what the finite step does to the
    innovations), `absorbed` (the part of it that the present parameters can undo), `valley` (the vector after that step
    and with it undone).
    """

    effect: str = eqx.field(static=True)
    form: AbstractEffect
    posterior: Posterior
    vector: Float[Numbers, " q"]
    gain: float
    linear_gain: float
    p_value: float
    one_step: dict[str, float] = eqx.field(static=True)
    detectable: dict[str, float] = eqx.field(static=True)
    shown: float
    absorbed: float
    valley: Float[Numbers, " q"]


def forms_to_try(
    form: type[AbstractEffect], scales: dict[str, float], periods: dict[str, tuple[float, ...]]
) -> list[AbstractEffect]:
    """Instances of one form at zero strength, one for every grid point of its nuisances.

    **Arguments:**

    - `form`: the class.
    - `scales`: the plant's sizes.
    - `periods`: name of a kind of period (`"odd_period"` ...) -> periods found in the data.
    """
    axes = []
    for nuisance in form.nuisances:
        if nuisance.grid == "period":
            axes.append([(nuisance.name, period) for period in periods[str(nuisance.scale)]])
        else:
            scale = nuisance.scale if isinstance(nuisance.scale, float) else scales[str(nuisance.scale)]
            axes.append([(nuisance.name, scale * value) for value in nuisance.grid])
    return [form(**dict(point)).in_turns_of(scales["turn"]) for point in itertools.product(*axes)]


class _Products(NamedTuple):
    """Of one weighing, the products of the weighted columns of `k` finite steps: with the base, `cross`; with each
    other, `gram`; with the innovations, `right`; and, cluster by cluster, with the `fine` ones, `clusters`."""

    cross: Float[np.ndarray, "q k"]
    gram: Float[np.ndarray, "k k"]
    right: Float[np.ndarray, " k"]
    clusters: Float[np.ndarray, "c k"]

    def of(self, own: slice) -> "_Products":
        """Those of a part of the steps."""
        return _Products(self.cross[:, own], self.gram[own, own], self.right[own], self.clusters[:, own])


def _regressed(
    errors: Float[np.ndarray, "k r n"], sizes: Float[np.ndarray, " k"], present: Present
) -> tuple[Bool[np.ndarray, " k"], list[_Products]]:
    """Finite steps of these `sizes`, whose innovations are the `errors`: which of them say something of a small
    effect, and their products for each weighing of the `present` model."""
    e, block = present.e, present.posterior.batch.block
    columns = errors - e[None]
    with np.errstate(over="ignore", invalid="ignore"):
        thrown = np.sqrt([np.vdot(column, column) / column.size for column in columns])
    # A step through a break-away event can throw the trajectory.
    good = np.isfinite(thrown) & (thrown < _THROWN * np.sqrt(np.vdot(e, e) / e.size))
    columns /= sizes[:, None, None]
    columns[~good] = 0.0
    flat = columns.reshape(columns.shape[0], -1)
    products = []
    for weighing in present.weighings:
        weighted = columns * weighing.weight[None]
        rows = weighted.reshape(columns.shape[0], -1)
        clusters = sum_clusters(weighted * present.fine[None], block)
        products.append(_Products(weighing.base @ flat.T, rows @ flat.T, rows @ e.ravel(), clusters))
    return good, products


class Promise(NamedTuple):
    """What the regression on one finite step promises; `simulated` makes a `Trial` of it."""

    form: AbstractEffect
    posterior: Posterior
    where: tuple[int, ...]
    candidates: list
    linear_gain: float
    p_value: float
    spread: np.ndarray
    shown: float
    absorbed: float
    valley: np.ndarray


class _Probe(NamedTuple):
    """One finite step: where in the layout, and how far in each of these."""

    form: AbstractEffect
    posterior: Posterior
    vector: Float[Numbers, " q"]
    where: tuple[int, ...]
    sizes: tuple[float, ...]


def try_form(
    present: Present, instances: list[AbstractEffect], scales: dict[str, float], *, effort: Effort = Effort()
) -> list[Trial]:
    """Test one form of an effect against the `present` model: its `promises_of`, `simulated`."""
    least = effort.screening.least_promise
    return simulated(present, promises_of(present, [instances], scales), least)[0]


def worth_simulating(promised: list[list[Promise]], *, effort: Effort = Effort()) -> float:
    """Linear gain below which none of what all forms `promised` is worth a simulation, by the `effort`."""
    most = max((promise.linear_gain for some in promised for promise in some), default=0.0)
    return max(effort.screening.least_promise, effort.screening.faint * most)


def promises_of(
    present: Present, forms: Sequence[list[AbstractEffect]], scales: dict[str, float]
) -> list[list[Promise]]:
    """What forms of effects promise beside the `present` model, those of each best first.

    **Arguments:**

    - `present`: the fitted model.
    - `forms`: each a form at zero strength, at each point of its grid.
    - `scales`: the plant's sizes.

    **Returns:**

    For each form one `Promise` per instance and finite step, unless the step threw the motion.
    """
    blocks = [
        (number, probes)
        for number, instances in enumerate(forms)
        for probes in _side_by_side([p for instance in instances for p in _probes(present, instance, scales)])
    ]
    promises: list[list[Promise]] = [[] for _ in forms]
    for (number, probes), errors in zip(
        blocks, present.lanes(_steps(some) for _, some in blocks), strict=True
    ):
        sizes = np.ones(len(errors))
        steps = [size for probe in probes for size in probe.sizes]
        sizes[: len(steps)] = steps
        good, products = _regressed(errors, sizes, present)
        first = 0
        for probe in probes:
            own = slice(first, first + len(probe.where))
            first += len(probe.where)
            if np.all(good[own]):
                promise = _promise(present, probe, [product.of(own) for product in products])
                promises[number].append(promise)
    return [sorted(some, key=lambda promise: -promise.linear_gain) for some in promises]


def lots(items: Sequence[_T], size: int) -> list[Sequence[_T]]:
    """The `items`, as many together as `size` says."""
    return [items[first : first + size] for first in range(0, len(items), size)]


def _steps(probes: list[_Probe]) -> tuple[list[Posterior], list[np.ndarray]]:
    """Posterior and vector of each step of the `probes`."""
    posteriors = [probe.posterior for probe in probes for _ in probe.where]
    vectors = [
        _further(probe.vector, place, size)
        for probe in probes
        for place, size in zip(probe.where, probe.sizes, strict=True)
    ]
    return posteriors, vectors


def _further(vector: Float[Numbers, " q"], place: int, size: float) -> np.ndarray:
    """The `vector` with `size` more at one place."""
    more = np.array(vector)
    more[place] += size
    return more


def _side_by_side(probes: list[_Probe]) -> list[list[_Probe]]:
    """The `probes`, as many together as there are lanes for their steps; one that has more steps is alone."""
    together: list[list[_Probe]] = []
    for probe in probes:
        if not together or sum(len(other.where) for other in together[-1]) + len(probe.where) > BESIDE:
            together.append([])
        together[-1].append(probe)
    return together


def _probes(present: Present, instance: AbstractEffect, scales: dict[str, float]) -> list[_Probe]:
    posterior, vector = extend(present.posterior, present.vector, instance, scales, present.drive)
    names = [strength.name for strength in instance.strengths]
    where = [
        i
        for i in range(len(present.posterior.layout), len(posterior.layout))
        if posterior.layout[i].parameter.name in names
    ]
    strengths = [posterior.layout[i].parameter for i in where]
    if len(where) == 1:
        steps = [((where[0],), (size,)) for size in strengths[0].probes]
    else:
        steps = [(tuple(where), tuple(p.probes[0] for p in strengths))]
    return [_Probe(instance, posterior, vector, *step) for step in steps]


def _promise(present: Present, probe: _Probe, products: list[_Products]) -> Promise:
    posterior, vector, where = probe.posterior, np.asarray(probe.vector), probe.where
    old, count, size = len(present.posterior.layout), len(posterior.layout), len(probe.where)
    recordings = vector.shape[0] - count
    # Present parameters (the first `old`), bristle deflections, then the strengths under test.
    position = np.concatenate([np.arange(old), np.arange(count, count + recordings), np.asarray(where)])
    # Where a finite step has been, the motion is known.
    longest = np.full(position.size, LONGEST_STEP)
    longest[-size:] = np.maximum(LONGEST_STEP, np.abs(probe.sizes))
    candidates, linear, p_value = [], 0.0, 1.0
    spread, shown, absorbed, valley = np.full(size, np.inf), 0.0, 0.0, vector
    samples = max(present.samples, 1.0)
    for number, (weighing, product) in enumerate(zip(present.weighings, products, strict=True)):
        cross, own, right, clusters = product
        gram = np.block([[weighing.gram, cross], [cross.T, own + 1e-12 * np.eye(size)]])
        whole = np.concatenate([weighing.right, right])
        if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(whole))):
            continue
        step = -np.linalg.lstsq(gram, whole, rcond=None)[0]
        without = -np.linalg.lstsq(weighing.gram, weighing.right, rcond=None)[0]
        linear = max(linear, float(-(whole @ step) + weighing.right @ without) / samples)
        for damping in _DAMPING:
            change = np.zeros(vector.shape[0])
            change[position] = damping * np.clip(step, -longest, longest)
            candidates.append(vector + change)
        if number == 0:
            coefficients = np.linalg.lstsq(weighing.gram, cross, rcond=None)[0]
            far, undone = np.asarray(probe.sizes), np.zeros(vector.shape[0])
            shown = float(far @ own @ far) / samples
            absorbed = float(far @ cross.T @ coefficients @ far) / samples / max(shown, _NOTHING)
            undone[position[:-size]] = np.clip(coefficients @ far, -LONGEST_STEP, LONGEST_STEP)
            valley = vector - undone
            valley[list(where)] += far
            projected = clusters - weighing.clusters @ coefficients
            projected = merged(projected, recordings)
            # Of what does nothing only rounding is left, which depends on the units and may look significant.
            p_value = _score_test(projected) if np.any(np.diag(own) > _NOTHING) else 1.0
            if size == 1 and posterior.layout[where[0]].parameter.lower == 0.0:
                # A strength that cannot be negative is tested on its own side.
                p_value = 0.5 * p_value if step[-1] > 0.0 else 1.0 - 0.5 * p_value
            information = np.linalg.pinv(gram, hermitian=True)[-size:, -size:]
            spread = np.sqrt(np.diag(information @ (projected.T @ projected) @ information))
            # What does nothing to these recordings would not be seen at any size.
            spread = np.where(np.diag(own) > _NOTHING, spread, np.inf)
    return Promise(probe.form, posterior, where, candidates, linear, p_value, spread, shown, absorbed, valley)


def simulated(present: Present, promised: Sequence[list[Promise]], least: float) -> list[list[Trial]]:
    """The trials of what each of some forms `promised`, best first. Those that come to no more than `least` are not
    simulated, and have no gain; of the first every candidate is, of the second the undamped ones, of the others none.
    """
    blocks = [
        (number, some)
        for number, promises in enumerate(promised)
        for some in lots(_worth_it(promises, least), BESIDE)
    ]
    best: list[dict[int, tuple[float, np.ndarray]]] = [{} for _ in promised]
    runs = present.lanes(
        ([promised[number][rank].posterior for rank, _ in some], [vector for _, vector in some])
        for number, some in blocks
    )
    fitted, batch = np.asarray(present.posterior.fitted[0]), present.posterior.batch
    for (number, some), errors in zip(blocks, runs, strict=True):
        powers = block_power(errors[: len(some)], batch)
        for (rank, vector), power in zip(some, powers, strict=True):
            gain = present.misfit - misfit_of(power, fitted, batch)
            if rank not in best[number] or gain > best[number][rank][0]:
                best[number][rank] = gain, vector
    return [
        [
            _trial(promise, *found.get(rank, (-np.inf, np.asarray(promise.posterior.start))))
            for rank, promise in enumerate(promises)
        ]
        for promises, found in zip(promised, best, strict=True)
    ]


def _worth_it(promises: list[Promise], least: float) -> list[tuple[int, np.ndarray]]:
    """Rank and vector of those candidates of one form's `promises` that are simulated."""
    return [
        (rank, vector)
        for rank, promise in enumerate(promises[:2])
        if promise.linear_gain > least
        for vector in promise.candidates[:: 1 if rank == 0 else len(_DAMPING)]
    ]


def _trial(promise: Promise, gain: float, vector: np.ndarray) -> Trial:
    free = [promise.posterior.layout[i] for i in promise.where]
    return Trial(
        effect=promise.form.name,
        form=promise.form,
        posterior=promise.posterior,
        vector=vector,
        gain=gain,
        linear_gain=promise.linear_gain,
        p_value=promise.p_value,
        one_step={
            p.parameter.name: float(np.clip(vector[i] * p.scale, p.parameter.lower, p.parameter.upper))
            for p, i in zip(free, promise.where, strict=True)
        },
        detectable={
            p.parameter.name: float(4.0 * s * p.scale) for p, s in zip(free, promise.spread, strict=True)
        },
        shown=promise.shown,
        absorbed=promise.absorbed,
        valley=promise.valley,
    )


def _score_test(gradients: np.ndarray) -> float:
    """p-value of "all strengths are zero" from cluster gradients, shape `(c, k)`: Hotelling's T^2 of their mean, robust
    to what correlates inside a cluster."""
    used = gradients[np.any(gradients != 0.0, axis=1)]
    clusters, count = used.shape
    if clusters <= count + 1 or not np.all(np.isfinite(used)):
        return 1.0
    mean = used.mean(axis=0)
    covariance = np.atleast_2d(np.cov(used, rowvar=False))
    statistic = clusters * float(mean @ np.linalg.lstsq(covariance, mean, rcond=None)[0])
    return float(
        scipy.stats.f.sf(statistic * (clusters - count) / (count * (clusters - 1)), count, clusters - count)
    )
