"""Levenberg-Marquardt on the robust posterior of a diagnosis: one compiled call a step, whatever the structure.

The scale of the Cauchy loss comes down from the upper quantiles of the block powers to the noise: with the scale at the
noise from the start, a regime that the model misses would be ignored. Starting deflections of held-out recordings
follow on their own.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from frictionjax.core.arrays import Numbers
from frictionjax.estimation.descent.stepper import AbstractPlace, Ending, Stepper
from frictionjax.estimation.objective.loss import GRADUATION
from frictionjax.estimation.objective.misfit import losses_of, misfit_of
from frictionjax.estimation.objective.posterior import Posterior
from frictionjax.estimation.objective.quadratic import Evaluation, Quadratic
from frictionjax.estimation.objective.robust import graduated
from frictionjax.estimation.parameters import changed

_LEVEL = 0.95  # quantile of the block powers that is the scale of the loss: blocks below it count as in least squares
_A_NAT = 1.0  # what a coordinate is worth: less is no reason to descend again
_STEPPER = Stepper()


class RobustFit(NamedTuple):
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


class _RobustPlace(AbstractPlace):
    """A `vector` on the way down a `posterior`, what was evaluated there, and the cost `near` it; a gain of less than
    the part `tolerance` of the misfit is a small one."""

    posterior: Posterior
    tolerance: float
    vector: Float[np.ndarray, " q"]
    evaluations: tuple[Evaluation, ...]
    near: Quadratic

    @property
    def cost(self) -> float:
        """At the vector."""
        return float(self.near.cost)

    @property
    def gradient(self) -> Float[np.ndarray, " q"]:
        """Of the cost."""
        return np.asarray(self.near.gradient)

    @property
    def hessian(self) -> Float[np.ndarray, "q q"]:
        """Of the cost, by Gauss and Newton."""
        return np.asarray(self.near.hessian)

    @property
    def longest(self) -> Float[np.ndarray, " q"]:
        """Step: the unit of a strength is only where its effect becomes visible, so that it may at least double."""
        found = np.full(self.vector.size, _STEPPER.longest)
        layout = self.posterior.layout
        strengths = [i for i, free in enumerate(layout) if free.parameter.transform == "linear"]
        found[strengths] = np.maximum(_STEPPER.longest, np.abs(self.vector[strengths]))
        return found

    def moved(self, step: Float[np.ndarray, " q"]) -> "_RobustPlace":
        """The place a `step` further: parameters and fitted deflections together, the others each alone."""
        posterior, proposed = self.posterior, self.vector + step
        held_out = np.flatnonzero(np.asarray(posterior.fitted[0]) == 0.0) + posterior.parameters
        proposed[held_out] = np.clip(proposed[held_out], -1.0, 1.0)
        return _place(posterior, proposed, posterior.evaluated(proposed), self.tolerance)

    def is_near(self, there: "_RobustPlace") -> bool:
        """Whether the way `there` takes a negligible part off the misfit."""
        return self._per_sample(self.cost - there.cost) < self._negligible()

    def is_minimum(self) -> bool:
        """Whether the undamped step promises a negligible gain: g' H^-1 g / 2."""
        gradient = self.gradient
        promised = 0.5 * float(gradient @ np.linalg.lstsq(self.hessian, gradient, rcond=1e-12)[0])
        return self._per_sample(promised) < self._negligible()

    def _per_sample(self, cost: float) -> float:
        """Half a nat of the `cost` is one of the misfit."""
        return 0.5 * cost / _samples(self.posterior)

    def _negligible(self) -> float:
        """Gain per sample that is negligible. The cost is a logarithm: far from the noise, too, a nat is a factor e in
        the errors."""
        misfit = self._per_sample(self.cost - _cost_at_scale(self.posterior))
        return max(1e-5, self.tolerance * min(misfit, 1.0))


def _place(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    evaluations: tuple[Evaluation, ...],
    tolerance: float,
) -> _RobustPlace:
    return _RobustPlace(
        posterior, tolerance, np.asarray(vector), evaluations, posterior.assembled(evaluations, vector)
    )


def descend(
    posterior: Posterior,
    vector: Float[Numbers, " q"],
    *,
    graduate: bool = True,
    steps: int = 30,
    tolerance: float = 2e-3,
) -> RobustFit:
    """Bring the robust misfit of `posterior` down from `vector`.

    **Arguments:**

    - `posterior`, `vector`: what to fit, and where to start.
    - `graduate`: whether to begin with large scales of the loss.
    - `steps`: at most this many with the scale at the noise.
    - `tolerance`: the descent has converged when two steps in a row take less than this part off the misfit, or off
        one nat where that is less (or 1e-5).
    """
    there, evaluations = np.asarray(vector), posterior.evaluated(vector)
    if graduate:
        for quantile in GRADUATION:
            scale = _scale(posterior, evaluations, quantile)
            if scale > 1.0:
                there, evaluations = _brought_down(posterior, there, evaluations, scale, 4, 0.05)
    first = _place(graduated(posterior, 1.0), there, evaluations, tolerance)
    end, ending, _ = _STEPPER.descend(first, steps)
    other = _unbent(end) if steps else None
    if other is not None:
        end, ending, _ = _STEPPER.descend(other, steps)
    misfit = misfit_of(np.asarray(end.near.powers[0]), np.asarray(posterior.fitted[0]), posterior.batch)
    return RobustFit(end.vector, end.near, misfit, ending)


def _unbent(end: _RobustPlace) -> _RobustPlace | None:
    """The `end` with the bristles of held-out recordings unbent in the beginning where that leaves less; None where it
    does nowhere. While the parameters were others such a deflection may have gone so far astray that no small step of
    it leads back: in stick each deflection but the true one is as bad as the next."""
    posterior, fitted = end.posterior, np.asarray(end.posterior.fitted[0]) > 0
    if np.all(fitted):
        return None
    held_out = np.flatnonzero(~fitted)
    there = changed(end.vector, posterior.parameters + held_out, 0.0)
    now, then = (
        np.sum(losses_of(power, posterior.batch), axis=1)[held_out]
        for power in (np.asarray(end.near.powers[0]), posterior.powers([there])[0])
    )
    better = held_out[then < now - _A_NAT]
    if not better.size:
        return None
    there = changed(end.vector, posterior.parameters + better, 0.0)
    return _place(posterior, there, posterior.evaluated(there), end.tolerance)


def level_out(posterior: Posterior, vector: Float[Numbers, " q"]) -> Float[Numbers, " q"]:
    """Bring down, from `vector`, a nearly quadratic cost: only the largest blocks are weighed down.

    The robust cost ignores what it cannot explain: with friction that differs by direction it may fit one direction to
    the noise and ignore the other. No small step leads away from there; one does from where both misfit equally.
    """
    there, evaluations = np.asarray(vector), posterior.evaluated(vector)
    for _ in range(2):  # the second with the scale of the blocks at the new vector
        scale = _scale(posterior, evaluations, _LEVEL)
        there, evaluations = _brought_down(posterior, there, evaluations, scale, 8, 0.01)
    return there


def _brought_down(
    posterior: Posterior,
    vector: Float[np.ndarray, " q"],
    evaluations: tuple[Evaluation, ...],
    scale: float,
    steps: int,
    tolerance: float,
) -> tuple[Float[np.ndarray, " q"], tuple[Evaluation, ...]]:
    """The vector, and what was evaluated there, after a few `steps` with the loss of this `scale`."""
    first = _place(graduated(posterior, scale), vector, evaluations, tolerance)
    end, _, _ = _STEPPER.descend(first, steps)
    return end.vector, end.evaluations


def _scale(posterior: Posterior, evaluations: tuple[Evaluation, ...], quantile: float) -> float:
    """That quantile of the powers of the blocks that are fitted, at least that of the noise."""
    fitted = np.asarray(posterior.fitted[0]) > 0
    scored = np.asarray(posterior.batch.block_count)[fitted] > 0
    power = np.nan_to_num(np.asarray(evaluations[0].power)[fitted][scored], nan=1e30)
    return max(float(np.quantile(power, quantile)), 1.0)


def _cost_at_scale(posterior: Posterior) -> float:
    """Cost of the fitted recordings with every block at the scale of the loss."""
    scale = posterior.loss.knee  # type: ignore[attr-defined]
    fitted, count = np.asarray(posterior.fitted[0])[:, None], np.asarray(posterior.batch.block_count)
    weight = np.asarray(posterior.weights[0]).reshape(count.shape)
    return 0.5 * float(np.sum(fitted * weight * count)) * float(posterior.loss.cost(scale))


def _samples(posterior: Posterior) -> float:
    """How many samples the fitted recordings have."""
    fitted = np.asarray(posterior.fitted[0])[:, None]
    return float(np.sum(fitted * np.asarray(posterior.batch.block_count)))
