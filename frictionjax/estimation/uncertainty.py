"""Standard errors that hold under model error and correlated residuals: a jackknife, clustered in time.

The covariance of a free vector (`covariance_of`) becomes the standard errors of physical values in one place,
`standard_errors`: for a fit, for many fits and for a diagnosis.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from frictionjax.core import Estimate
from frictionjax.core.arrays import Numbers
from frictionjax.estimation.objective.model import physical
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic
from frictionjax.estimation.parameters import Free, at_an_end

_FEWEST = 30
"""Clusters: with fewer their scatter is hardly known."""
_FEW = 20  # clusters: fewer tell nothing of how errors correlate
_MOST_OWN = 0.9
_BY_PRIOR = (
    0.25  # of the prior's variance, half of its standard deviation: with more a value rests on the prior
)
_TOGETHER = (4, 2, 1)  # clusters of 0.5 s that are added up, while enough are left


def merged(gradients: Float[np.ndarray, "c k"], recordings: int) -> Float[np.ndarray, "m k"]:
    """Gradients of clusters of 0.5 s, in order of the `recordings`, added up to clusters of 2 s; of 1 s or 0.5 s where
    fewer than `_FEWEST` would be left.

    Model error is correlated over more than half a second after the parameters have adapted to it: with clusters of
    0.5 s p-values come out too small (`python -m benchmarks.null_p_values`).
    """
    sums = gradients
    for together in _TOGETHER:
        sums = _summed(gradients, recordings, together)
        if _enough(sums):
            break
    return sums


def _summed(values: Float[np.ndarray, "c k"], recordings: int, together: int) -> Float[np.ndarray, "m k"]:
    """Sums of so many `values` in a row, none across two recordings."""
    each = values.reshape(recordings, -1, values.shape[-1])
    padded = np.pad(each, ((0, 0), (0, -each.shape[1] % together), (0, 0)))
    return padded.reshape(-1, together, each.shape[-1]).sum(axis=1)


def _enough(sums: Float[np.ndarray, "m k"]) -> bool:
    return bool(np.sum(np.any(sums != 0.0, axis=1)) >= _FEWEST)


def jackknife(
    hessian: Float[np.ndarray, "q q"],
    gradients: Float[np.ndarray, "c q"],
    curvatures: Float[np.ndarray, "c q q"],
) -> Float[np.ndarray, "q q"]:
    """Covariance (c-1)/c sum_c d_c d_c' of the free vector, d_c = (H - H_c)^-1 g_c what it would change by without
    cluster c.

    A single break-away may carry more information than seconds of sliding, and the fit follows it: the residuals there
    are small, and so is the sandwich, which treats every cluster as one of many. Of each cluster only the part
    `_MOST_OWN` is left out: without all of it a parameter that it alone determines would have no error at all.
    """
    active = np.any(gradients != 0.0, axis=1)
    gradients, rest = gradients[active], hessian - _MOST_OWN * curvatures[active]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    matrices = rest * np.outer(scale, scale)
    changes = scale * np.linalg.solve(matrices, (gradients * scale)[..., None])[..., 0]
    return changes.T @ changes * (max(len(changes) - 1, 1) / max(len(changes), 1))


def inverse_of(matrix: Float[np.ndarray, "q q"]) -> Float[np.ndarray, "q q"]:
    """Inverse of a positive definite `matrix`, scaled first: its entries span decades."""
    size = np.sqrt(np.diag(matrix))
    size = np.where(size > 0.0, size, 1.0)
    return np.linalg.pinv(matrix / np.outer(size, size), hermitian=True) / np.outer(size, size)


def clustered_covariance(
    hessian: Float[np.ndarray, "q q"],
    gradients: Sequence[Float[np.ndarray, "_ q"]],
    curvatures: Sequence[Float[np.ndarray, "_ q q"]],
    rows: Sequence[int],
) -> Float[np.ndarray, "q q"]:
    """Covariance of the free vector: the jackknife over clusters of 0.5 s, its variances raised where longer clusters
    or white errors give more; infinite where a derivative is not finite.

    Each of the three can only be short: clusters of 0.5 s where what the model leaves is correlated for longer; those
    of 2 s because they are few; both where a coordinate is determined by its weak prior, along which the data do not
    scatter; and white errors, H^-1, where errors are correlated. With fewer than `_FEW` clusters white errors are all
    that can be stated: one cluster that determines a parameter alone would seem to be contradicted by the others.

    **Arguments:**

    - `hessian`: of the cost, with the prior.
    - `gradients`, `curvatures`: of each cluster, evidence by evidence.
    - `rows`: recordings of each evidence; 0 where its clusters are in no order of time.
    """
    if not all(np.all(np.isfinite(some)) for some in (hessian, *gradients)):
        return np.full(hessian.shape, np.inf)
    white = inverse_of(hessian)
    if sum(int(np.sum(np.any(own != 0.0, axis=1))) for own in gradients) < _FEW:
        return white
    covariance = jackknife(hessian, np.concatenate(gradients), np.concatenate(curvatures))
    long = jackknife(hessian, *_longer(gradients, curvatures, rows))
    most = np.maximum(np.diag(white), np.diag(long))
    return covariance + np.diag(np.maximum(most - np.diag(covariance), 0.0))


def covariance_of(
    posterior: Posterior, evaluations: tuple[Evaluation, ...], near: Quadratic
) -> Float[np.ndarray, "q q"]:
    """The `clustered_covariance` at a minimum of the `posterior`, from `evaluations` there and the cost `near` it."""
    return clustered_covariance(
        np.asarray(near.hessian),
        [np.asarray(own) for own in near.clusters],
        posterior.curvatures(evaluations),
        [one.rows for one in posterior.evidence],
    )


def _longer(
    gradients: Sequence[Float[np.ndarray, "_ q"]],
    curvatures: Sequence[Float[np.ndarray, "_ q q"]],
    rows: Sequence[int],
) -> tuple[Float[np.ndarray, "m q"], Float[np.ndarray, "m q q"]]:
    """Gradients and curvatures of clusters of 2 s, as `merged` has them."""
    count = gradients[0].shape[1]
    both = [
        np.concatenate([own, bent.reshape(-1, count * count)], axis=1)
        for own, bent in zip(gradients, curvatures, strict=True)
    ]
    sums = both[0]
    for together in _TOGETHER:
        sums = np.concatenate(
            [_summed(own, many, together) if many else own for own, many in zip(both, rows, strict=True)]
        )
        if _enough(sums):
            break
    return sums[:, :count], sums[:, count:].reshape(-1, count, count)


class StandardErrors(NamedTuple):
    """What is known of k physical values: their covariance by the inverse information, `white`, and with standard
    deviations raised where clusters say more, `covariance`, shape `(k, k)` each; and the standard errors `stderr`,
    shape `(k,)`, infinite where the data do not determine a value."""

    white: Float[np.ndarray, "k k"]
    covariance: Float[np.ndarray, "k k"]
    stderr: Float[np.ndarray, " k"]


def standard_errors(
    slopes: Float[np.ndarray, "k q"],
    hessian: Float[np.ndarray, "q q"],
    clustered: Float[np.ndarray, "q q"],
    prior: Float[np.ndarray, " q"],
    at_end: Bool[np.ndarray, " k"],
) -> StandardErrors:
    """Standard errors of physical values by the delta method, from the covariance of a free vector.

    They are those of the inverse information, raised where clusters of correlated errors say more: in the coordinates
    of the fit the clustered covariance is never below the white one, but the values are no such coordinates. A value at
    the end of its range, or that rests on the weak prior, is not determined by the data, however little the gradients
    scatter: its error is infinite. The prior is judged on the values, not on their coordinates: some of these are
    ratios, of which one part may be known. Where a derivative is not finite all errors are infinite.

    **Arguments:**

    - `slopes`: of the values by the free vector.
    - `hessian`: of the cost, with the prior.
    - `clustered`: covariance of the free vector (`clustered_covariance`).
    - `prior`: inverse standard deviations of the weak prior.
    - `at_end`: which values are at the end of their range.
    """
    size = len(slopes)
    if not (np.all(np.isfinite(hessian)) and np.all(np.isfinite(clustered))):
        unknown = np.full((size, size), np.inf)
        return StandardErrors(unknown, unknown, np.full(size, np.inf))
    white = slopes @ inverse_of(hessian) @ slopes.T
    covariance = _raised(white, slopes @ clustered @ slopes.T)
    by_prior = np.diag(white) > _BY_PRIOR * np.sum((slopes / prior) ** 2, axis=1)
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return StandardErrors(white, covariance, np.where(by_prior | at_end, np.inf, stderr))


def _raised(white: Float[np.ndarray, "k k"], clustered: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """The `white` covariance, with standard deviations raised where the `clustered` one has larger ones."""
    more = np.sqrt(np.maximum(np.diag(clustered) / np.maximum(np.diag(white), 1e-300), 1.0))
    return white * np.outer(more, more)


class Uncertainty(NamedTuple):
    """The physical `values` of the p free and then of the tied parameters at a minimum, shape `(k,)`, their `errors`,
    and which free ones are at the end of their range, `at_end`, shape `(p,)`."""

    values: Float[np.ndarray, " k"]
    errors: StandardErrors
    at_end: Bool[np.ndarray, " p"]


def uncertainty_at(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    evaluations: tuple[Evaluation, ...],
    near: Quadratic,
) -> Uncertainty:
    """The physical values of the parameters of `posterior` at the free `vector`, shape `(q,)`, with their
    `standard_errors` by the covariance at the minimum of a descent: of the `evaluations` and the cost `near` there."""
    constraints, count = posterior.constraints, posterior.parameters
    values, slopes = physical(posterior.model, np.asarray(vector)[:count])
    start = np.asarray(posterior.start)[:count]
    at_end = np.asarray(at_an_end(constraints.layout, np.asarray(vector)[:count], start, values[:count]))
    ended = {one.label for one, end in zip(constraints.layout, at_end, strict=True) if end}
    tied = np.array([tie.source in ended for tie in constraints.ties], dtype=bool)
    # No value depends on a starting deflection.
    hessian, prior = np.asarray(near.hessian), np.asarray(posterior.prior)
    slopes = np.pad(slopes, ((0, 0), (0, prior.size - count)))
    clustered = covariance_of(posterior, evaluations, near)
    errors = standard_errors(slopes, hessian, clustered, prior, np.concatenate([at_end, tied]))
    return Uncertainty(values, errors, at_end)


def estimates(posterior: Posterior, known: Uncertainty, units: Mapping[str, str]) -> dict[str, Estimate]:
    """Label -> `Estimate` of the free and of the tied parameters of `posterior`, of whose values this is `known`;
    `units` names force, position and input."""
    layout, ties = posterior.constraints.layout, posterior.constraints.ties
    pairs = list(zip(known.values, known.errors.stderr, strict=True))
    found = {
        free.label: _estimate_of(free, value, stderr, units)
        for free, (value, stderr) in zip(layout, pairs[: len(layout)], strict=True)
    }
    for tie, (value, stderr) in zip(ties, pairs[len(layout) :], strict=True):
        source = found.get(tie.source)
        # What follows a fixed parameter is known as that is.
        error = float(stderr) if source is None or np.isfinite(source.stderr) else float("inf")
        identified = source is None or source.identified
        found[tie.label] = Estimate(float(value), error, _unit_of(tie.unit, units), identified)
    return found


def _estimate_of(free: Free, value: float, stderr: float, units: Mapping[str, str]) -> Estimate:
    """The parameter `free` with its `value` and standard error `stderr`; one whose standard error exceeds half its
    value (or that the weak prior determines) is not identified."""
    positive = free.parameter.transform == "log"
    # Without a slope a standard error of zero has no meaning.
    identified = bool(0.0 < stderr < np.inf) and (not positive or bool(stderr < 0.5 * abs(value)))
    known = float(stderr) if stderr > 0.0 else float("inf")
    return Estimate(float(value), known, _unit_of(free.parameter.unit, units), identified)


def _unit_of(unit: str, units: Mapping[str, str]) -> str:
    """A `unit` with the names of force, position and input in it."""
    for name, text in units.items():
        unit = unit.replace("{" + name + "}", text)
    return unit
