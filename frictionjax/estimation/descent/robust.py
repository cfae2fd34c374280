"""Levenberg-Marquardt on the robust posterior of a diagnosis: one compiled call a step, whatever the structure.

The scale of the Cauchy loss comes down from the upper quantiles of the block powers to the noise: with the scale at the
noise from the start, a regime that the model misses would be ignored. Starting deflections of held-out recordings
follow on their own.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.descent.stepper import Ending, Stepper
from frictionjax.estimation.objective.loss import AT_THE_NOISE, GRADUATION
from frictionjax.estimation.objective.misfit import misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic
from frictionjax.estimation.objective.robust import graduated

_LEVEL = 0.95  # quantile of the block powers that is the scale of the loss: blocks below it count as in least squares
_STEPPER = Stepper()


class Fitted(NamedTuple):
    """Where a descent ended: `vector`, shape `(q,)`, the cost `near` it with the loss at the noise, its `misfit` per
    sample, and the `ending`."""

    vector: Float[Numbers, " q"]
    near: Quadratic
    misfit: float
    ending: Ending

    @property
    def converged(self) -> bool:
        """Whether the last steps gained next to nothing."""
        return self.ending is Ending.AT_REST

    @property
    def power(self) -> Float[np.ndarray, "r b"]:
        """Mean square of the standardised errors in each block of the recordings, shape `(r, b)`."""
        return np.asarray(self.near.powers[0])


class _Point(NamedTuple):
    """A vector, and what was evaluated there."""

    vector: Float[Numbers, " q"]
    evaluations: tuple[Evaluation, ...]


def descend(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    *,
    graduate: bool = True,
    steps: int = 30,
    tolerance: float = 2e-3,
) -> Fitted:
    """Bring the robust misfit of `posterior` down from `vector`.

    **Arguments:**

    - `posterior`, `vector`: what to fit, and where to start.
    - `graduate`: whether to begin with large scales of the loss.
    - `steps`: at most this many with the scale at the noise.
    - `tolerance`: the descent has converged when two steps in a row take less than this part off the misfit, or off
        one nat where that is less (or 1e-5).
    """
    point = _point(posterior, vector)
    if graduate:
        for quantile in GRADUATION:
            scale = _scale(posterior, point, quantile)
            if scale > AT_THE_NOISE:
                point, _, _ = _steps(graduated(posterior, scale), point, 4, 0.05)
    point, near, ending = _steps(graduated(posterior, 1.0), point, steps, tolerance)
    misfit = misfit_of(np.asarray(near.powers[0]), np.asarray(posterior.fitted[0]), posterior.batch)
    return Fitted(point.vector, near, misfit, ending)


def level_out(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
    """Bring down, from `vector`, a nearly quadratic cost: only the largest blocks are weighed down.

    The robust cost ignores what it cannot explain: with friction that differs by direction it may fit one direction to
    the noise and ignore the other. No small step leads away from there; one does from where both misfit equally.
    """
    point = _point(posterior, vector)
    for _ in range(2):  # the second with the scale of the blocks at the new vector
        point, _, _ = _steps(graduated(posterior, _scale(posterior, point, _LEVEL)), point, 8, 0.01)
    return point.vector


def _point(posterior: Posterior, vector: Float[Numbers, " q"]) -> _Point:
    vector = np.asarray(vector)
    return _Point(vector, posterior.evaluated(vector))


def _scale(posterior: Posterior, point: _Point, quantile: float) -> float:
    """That quantile of the powers of the blocks that are fitted, at least that of the noise."""
    fitted = np.asarray(posterior.fitted[0]) > 0
    scored = np.asarray(posterior.batch.block_count)[fitted] > 0
    power = np.nan_to_num(np.asarray(point.evaluations[0].power)[fitted][scored], nan=1e30)
    return max(float(np.quantile(power, quantile)), 1.0)


def _steps(
    posterior: Posterior, point: _Point, steps: int, tolerance: float
) -> tuple[_Point, Quadratic, Ending]:
    """At most so many `steps` down the `posterior` as it is: where they end, the cost near there, and why."""
    held_out = np.flatnonzero(np.asarray(posterior.fitted[0]) == 0.0) + posterior.parameters
    least, samples = _cost_at_scale(posterior)
    damping, small, near = _STEPPER.damping, 0, posterior.assembled(point.evaluations, point.vector)
    for _ in range(steps):
        if not np.all(np.isfinite(np.asarray(near.hessian))):
            return point, near, Ending.NOT_FINITE
        now = np.asarray(point.vector)
        proposed = now + _step(posterior, now, near, damping)
        proposed[held_out] = np.clip(proposed[held_out], -1.0, 1.0)
        there = _point(posterior, proposed)
        near_there = posterior.assembled(there.evaluations, there.vector)
        cost, new = float(near.cost), float(near_there.cost)
        # Half a nat of the cost is one of the misfit.
        negligible = _negligible(0.5 * (cost - least) / samples, tolerance)
        accepted, following = _STEPPER.judged(damping, new - cost)
        damping = float(following)
        if accepted:
            gained = 0.5 * (cost - new) / samples
            point, near = there, near_there
            small = small + 1 if gained < negligible else 0
            if small >= 2:
                return point, near, Ending.AT_REST
        elif damping > _STEPPER.most:
            converged = 0.5 * _predicted(near) / samples < negligible
            return point, near, Ending.AT_REST if converged else Ending.NO_STEP
    return point, near, Ending.STEPS


def _step(
    posterior: Posterior, vector: Float[np.ndarray, " q"], near: Quadratic, damping: float
) -> Float[np.ndarray, " q"]:
    """Damped Gauss-Newton step from `vector`: parameters and fitted deflections together, the others each alone."""
    # The unit of a strength is only where its effect becomes visible: it may at least double.
    longest = np.full(vector.size, _STEPPER.longest)
    strengths = [i for i, free in enumerate(posterior.layout) if free.parameter.transform == "linear"]
    longest[strengths] = np.maximum(_STEPPER.longest, np.abs(vector[strengths]))
    return np.asarray(_STEPPER.step(np.asarray(near.hessian), np.asarray(near.gradient), damping, longest))


def _cost_at_scale(posterior: Posterior) -> tuple[float, float]:
    """Cost of the fitted recordings with every block at the scale of the loss, and how many samples they have."""
    scale = posterior.loss.knee  # type: ignore[attr-defined]
    fitted, count = np.asarray(posterior.fitted[0])[:, None], np.asarray(posterior.batch.block_count)
    weight = np.asarray(posterior.weights[0]).reshape(count.shape)
    least = 0.5 * float(np.sum(fitted * weight * count)) * float(posterior.loss.cost(scale))
    return least, float(np.sum(fitted * count))


def _negligible(misfit: float, tolerance: float) -> float:
    """Gain per sample that is negligible. The cost is a logarithm: far from the noise, too, a nat is a factor e in the
    errors."""
    return max(1e-5, tolerance * min(misfit, 1.0))


def _predicted(near: Quadratic) -> float:
    """Reduction of the cost that the undamped step predicts: g' H^-1 g / 2."""
    gradient = np.asarray(near.gradient)
    return 0.5 * float(gradient @ np.linalg.lstsq(np.asarray(near.hessian), gradient, rcond=1e-12)[0])
