"""Standard errors that hold under model error and correlated residuals: the sandwich, clustered in time."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from frictionjax.core import Estimate
from frictionjax.core.arrays import Numbers
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic
from frictionjax.estimation.parameters import Free, physical

_FEWEST = 30
"""Clusters: with fewer their scatter is hardly known."""
_FEW = 20  # clusters: fewer tell nothing of how errors correlate
_MOST_OWN = 0.9
_TOGETHER = (4, 2, 1)  # clusters of 0.5 s that are added up, while enough are left


def merged(gradients: Float[np.ndarray, "c k"], recordings: int) -> Float[np.ndarray, "m k"]:
    """Gradients of clusters of 0.5 s, in order of the `recordings`, added up to clusters of 2 s; of 1 s or 0.5 s where
    fewer than `_FEWEST` would be left.

    Model error is correlated over more than half a second after the parameters have adapted to it: with clusters of
    0.5 s p-values come out too small (`python -m benchmarks.null_p_values`).
    """
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


def sandwich(
    hessian: Float[np.ndarray, "q q"], gradients: Float[np.ndarray, "c q"]
) -> Float[np.ndarray, "q q"]:
    """Covariance H^-1 (sum_c g_c g_c') H^-1 c/(c-1) of the free vector, from the gradient of each cluster."""
    inverse = np.linalg.pinv(hessian, hermitian=True)
    active = int(np.sum(np.any(gradients != 0.0, axis=1)))
    return inverse @ (gradients.T @ gradients) @ inverse * (active / max(active - 1, 1))


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


def raised(white: Float[np.ndarray, "p p"], clustered: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """The `white` covariance of physical values, with standard deviations raised where the `clustered` one has larger
    ones: the values are no coordinates of the fit, in which it is never below the white one."""
    more = np.sqrt(np.maximum(np.diag(clustered) / np.maximum(np.diag(white), 1e-300), 1.0))
    return white * np.outer(more, more)


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
    for together in _TOGETHER:
        sums = np.concatenate(
            [_summed(own, many, together) if many else own for own, many in zip(both, rows, strict=True)]
        )
        if _enough(sums):
            break
    return sums[:, :count], sums[:, count:].reshape(-1, count, count)


def estimates(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    covariance: Float[np.ndarray, "q q"],
    units: dict[str, str],
) -> dict[str, Estimate]:
    """Physical values with standard errors by the delta method; label -> `Estimate`."""
    layout, count = posterior.layout, posterior.parameters
    values, jacobian = physical(layout, posterior.drive, vector[:count], posterior.start[:count])
    if np.all(np.isfinite(covariance)):
        spread = np.sqrt(np.maximum(np.diag(jacobian @ covariance[:count, :count] @ jacobian.T), 0.0))
    else:
        spread = np.full(count, np.inf)
    return {
        free.label: estimate_of(free, value, stderr, units)
        for free, value, stderr in zip(layout, values, spread, strict=True)
    }


def estimate_of(free: Free, value: float, stderr: float, units: Mapping[str, str]) -> Estimate:
    """The parameter `free` with its `value` and standard error `stderr`; `units` names force, position and input.

    One whose standard error exceeds half its value (or that the weak prior determines) is not identified.
    """
    positive = free.parameter.transform == "log"
    # A parameter at the end of its range has no slope left: a standard error of zero has no meaning.
    identified = bool(0.0 < stderr < np.inf) and (not positive or bool(stderr < 0.5 * abs(value)))
    unit = free.parameter.unit
    for name, text in units.items():
        unit = unit.replace("{" + name + "}", text)
    known = float(stderr) if stderr > 0.0 else float("inf")
    return Estimate(float(value), known, unit, identified)
