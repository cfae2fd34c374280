"""Levenberg-Marquardt on the robust cost of a `Joint`: one compiled call a step, whatever the structure.

The Cauchy knee comes down from the upper quantiles of the block powers to the noise: with the knee at the noise from
the start, a regime that the model misses would be ignored. Starting deflections of recordings kept aside follow on
their own.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.joint import Joint, misfit_of
from frictionjax.estimation.look import Look, Seen

_GRADUATION = (0.95, 0.8, 0.5)  # quantiles of the block powers that set the knee, in turn
_LEVEL = 0.95  # quantile of the block powers below which all count alike
_DAMPING, _LEAST, _MOST = 3e-2, 1e-6, 1e5
_LONGEST = 1.5  # in a coordinate; a strength, whose unit is only where it begins to show, may at least double


class Fitted(NamedTuple):
    """Where a descent ended: `vector`, shape `(q,)`, its `look` at the noise, its `misfit` per sample, and whether it
    `converged`."""

    vector: Float[Array, " q"]
    look: Look
    misfit: float
    converged: bool


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
    vector, _, look, rested = _walk(joint, vector, seen, 1.0, steps, tolerance)
    return Fitted(
        vector, look, misfit_of(np.asarray(look.power), np.asarray(joint.fitted), joint.batch), rested
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
) -> tuple[Float[Array, " q"], Seen, Look, bool]:
    """At most so many `steps` with the knee at the power `knee`: the vector, what is seen of it, its look, and whether
    it is at rest."""
    samples = float(np.sum(np.asarray(joint.batch.block_count) * np.asarray(joint.fitted)[:, None]))
    aside = np.flatnonzero(np.asarray(joint.fitted) == 0.0) + len(joint.layout)
    damping, still, look = _DAMPING, 0, joint.look_of(seen, vector, knee)
    for _ in range(steps):
        if not np.all(np.isfinite(np.asarray(look.hessian))):
            return vector, seen, look, False
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
            # The cost is a logarithm: far from the noise, too, a nat is a factor e in the errors.
            little = max(1e-5, tolerance * min(cost / samples, 1.0))
            still = still + 1 if gained < little else 0
            if still >= 2:
                return vector, seen, look, True
        else:
            damping *= 8.0
            if damping > _MOST:
                return vector, seen, look, True
    return vector, seen, look, False
