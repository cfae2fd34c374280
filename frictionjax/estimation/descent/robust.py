"""Levenberg-Marquardt on the robust cost of a `Joint`: one compiled call a step, whatever the structure.

The Cauchy knee comes down from the upper quantiles of the block powers to the noise: with the knee at the noise from
the start, a regime that the model misses would be ignored. Starting deflections of recordings kept aside follow on
their own.
"""

from enum import Enum
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.objective.joint import Joint, misfit_of
from frictionjax.estimation.objective.look import Look, Seen

_GRADUATION = (0.95, 0.8, 0.5)  # quantiles of the block powers that set the knee, in turn
_LEVEL = 0.95  # quantile of the block powers below which all count alike
_DAMPING, _LEAST, _MOST = 3e-2, 1e-6, 1e5
_LONGEST = 1.5  # in a coordinate; a strength, whose unit is only where it begins to show, may at least double


class Ending(Enum):
    """Why a descent ended; the value is what is to be said of it."""

    AT_REST = ""
    NO_STEP = "The fit stopped where no step lowers the cost although its slope promises more: the cost is rough there."
    STEPS = "The fit stopped while still improving slightly."
    NOT_FINITE = "The fit stopped where derivatives overflow."


class Fitted(NamedTuple):
    """Where a descent ended: `vector`, shape `(q,)`, its `look` at the noise, its `misfit` per sample, and the
    `ending`."""

    vector: Float[Array, " q"]
    look: Look
    misfit: float
    ending: Ending

    @property
    def converged(self) -> bool:
        """Whether the last steps gained next to nothing."""
        return self.ending is Ending.AT_REST


def _step(joint: Joint, vector: np.ndarray, look: Look, damping: float) -> np.ndarray:
    """Damped Gauss-Newton step from `vector`: parameters and fitted deflections together, the others each alone."""
    hessian, gradient = np.asarray(look.hessian), np.asarray(look.gradient)
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-12))
    matrix = hessian / np.outer(scale, scale) + damping * np.eye(scale.size)
    step = -np.linalg.lstsq(matrix, gradient / scale, rcond=1e-12)[0] / scale
    longest = np.full(scale.size, _LONGEST)
    strengths = [i for i, free in enumerate(joint.layout) if free.parameter.transform == "linear"]
    longest[strengths] = np.maximum(_LONGEST, np.abs(vector[strengths]))
    return np.clip(step, -longest, longest)


def descend(
    joint: Joint,
    vector: Float[Array, " q"],
    *,
    graduate: bool = True,
    steps: int = 30,
    tolerance: float = 2e-3,
) -> Fitted:
    """Bring the robust misfit of `joint` down from `vector`.

    **Arguments:**

    - `joint`, `vector`: what to fit, and where to start.
    - `graduate`: whether to begin with wide knees.
    - `steps`: at most this many with the knee at the noise.
    - `tolerance`: the descent is at rest when two steps in a row take less than this part off the misfit, or off
        one nat where that is less (or 1e-5).
    """
    vector = jnp.asarray(vector)
    seen = joint.seen(vector)
    if graduate:
        for quantile in _GRADUATION:
            knee = _knee(joint, seen, quantile)
            if knee > 1.2:
                vector, seen, _, _ = _walk(joint, vector, seen, knee, 4, 0.05)
    vector, _, look, ending = _walk(joint, vector, seen, 1.0, steps, tolerance)
    return Fitted(
        vector, look, misfit_of(np.asarray(look.power), np.asarray(joint.fitted), joint.batch), ending
    )


def level_out(joint: Joint, vector: Float[Array, " q"]) -> Float[Array, " q"]:
    """From `vector` down the cost in which all but the largest blocks count alike, whatever their power.

    The robust cost gives up what it cannot explain: with friction that differs by direction it may explain one of them
    to the noise and ignore the other. From there no small step leads on; from where both are missed alike one does.
    """
    vector = jnp.asarray(vector)
    seen = joint.seen(vector)
    for _ in range(2):  # the knee of the blocks that the new place leaves
        vector, seen, _, _ = _walk(joint, vector, seen, _knee(joint, seen, _LEVEL), 8, 0.01)
    return vector


def _knee(joint: Joint, seen: Seen, quantile: float) -> float:
    """That quantile of the powers of the blocks that are fitted, at least that of the noise."""
    fitted = np.asarray(joint.fitted) > 0
    scored = np.asarray(joint.batch.block_count)[fitted] > 0
    power = np.nan_to_num(np.asarray(seen.power)[fitted][scored], nan=1e30)
    return max(float(np.quantile(power, quantile)), 1.0)


def _walk(
    joint: Joint, vector: Float[Array, " q"], seen: Seen, knee: float, steps: int, tolerance: float
) -> tuple[Float[Array, " q"], Seen, Look, Ending]:
    """At most so many `steps` with the knee at the power `knee`: the vector, what is seen of it, its look, and why it
    ended."""
    samples = float(np.sum(np.asarray(joint.batch.block_count) * np.asarray(joint.fitted)[:, None]))
    aside = np.flatnonzero(np.asarray(joint.fitted) == 0.0) + len(joint.layout)
    damping, still, look = _DAMPING, 0, joint.look_of(seen, vector, knee)
    for _ in range(steps):
        if not np.all(np.isfinite(np.asarray(look.hessian))):
            return vector, seen, look, Ending.NOT_FINITE
        now = np.asarray(vector)
        tried = now + _step(joint, now, look, damping)
        tried[aside] = np.clip(tried[aside], -1.0, 1.0)
        there = joint.seen(jnp.asarray(tried))
        beyond = joint.look_of(there, jnp.asarray(tried), knee)
        cost, new = float(look.cost), float(beyond.cost)
        if np.isfinite(new) and new < cost:
            gained = (cost - new) / samples
            vector, seen, look = jnp.asarray(tried), there, beyond
            damping = max(damping / 5.0, _LEAST)
            still = still + 1 if gained < _little(cost / samples, tolerance) else 0
            if still >= 2:
                return vector, seen, look, Ending.AT_REST
        else:
            damping *= 8.0
            if damping > _MOST:
                rests = _promised(look) / samples < _little(cost / samples, tolerance)
                return vector, seen, look, Ending.AT_REST if rests else Ending.NO_STEP
    return vector, seen, look, Ending.STEPS


def _little(misfit: float, tolerance: float) -> float:
    """Gain per sample that is next to nothing. The cost is a logarithm: far from the noise, too, a nat is a factor e in
    the errors."""
    return max(1e-5, tolerance * min(misfit, 1.0))


def _promised(look: Look) -> float:
    """What the undamped step would take off the cost, were it the parabola of the `look`: g' H^-1 g / 2."""
    gradient = np.asarray(look.gradient)
    return 0.5 * float(gradient @ np.linalg.lstsq(np.asarray(look.hessian), gradient, rcond=1e-12)[0])
