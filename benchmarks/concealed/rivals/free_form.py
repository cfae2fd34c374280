"""Rival (d): a free-form model of the residual force in x, v and z; it predicts, and cannot name.

Piecewise linear in asinh(v/vs) and z on one grid, in x on another, and in x for each direction; ridge regression on the
fitted recordings, its strength chosen by leaving out each of them in turn.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.concealed.rivals.ground import Ground
from frictionjax.core import Parameter
from frictionjax.physics import LuGre
from frictionjax.physics.effects import About, AbstractForceEffect, Now

_SPEEDS, _BENDS, _PLACES = 9, 7, 16
_RIDGES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, np.inf)


class FreeForm(AbstractForceEffect):
    """J x'' = km u - F - f(v, z) - g(x) - h(x) s, with s the direction; all piecewise linear.

    **Attributes:** `weights` of all roofs, shape `(k,)` (force units); `middle`, `half` of x, v and z as they enter.
    """

    weights: Float[Array, " k"]
    middle: Float[Array, 3]
    half: Float[Array, 3]

    name: ClassVar[str] = "free_form"
    about: ClassVar[About] = About("a free-form force", "J x'' = km u - F - f(x, v, z)", "anywhere")
    strengths: ClassVar[tuple[Parameter, ...]] = ()
    nuisances: ClassVar[tuple[Parameter, ...]] = ()

    def force(self, friction: LuGre, now: Now) -> Float[Array, ""]:
        z = now.spring / friction.Fs
        roofs = features(jnp, now.x, jnp.arcsinh(now.v / friction.vs), z, self.middle, self.half)
        return jnp.sum(self.weights * roofs)


def _roofs(xp, place, count: int):
    """Roofs over `count` knots between -1 and 1, one more axis at the end."""
    knot = 0.5 * (count - 1) * (xp.clip(place, -1.0, 1.0) + 1.0)
    return xp.maximum(0.0, 1.0 - xp.abs(knot[..., None] - xp.arange(count, dtype=float)))


def features(xp, x, speed, bend, middle, half):
    """All roofs at x, asinh(v/vs) and F_z/Fs, shape `(..., k)`; `xp` is the array module."""
    v = _roofs(xp, (speed - middle[1]) / half[1], _SPEEDS)
    z = _roofs(xp, (bend - middle[2]) / half[2], _BENDS)
    place = _roofs(xp, (x - middle[0]) / half[0], _PLACES)
    both = (v[..., :, None] * z[..., None, :]).reshape((*v.shape[:-1], -1))
    return xp.concatenate([both, place, place * xp.tanh(speed)[..., None]], axis=-1)


def _left_out(grams: list[np.ndarray], rights: list[np.ndarray], powers: list[float], ridge: float) -> float:
    """Sum of squares on each recording, predicted from the others."""
    lost = 0.0
    for k in range(len(grams)):
        weights = _solved(sum(grams) - grams[k], sum(rights) - rights[k], ridge)
        lost += powers[k] - 2.0 * float(weights @ rights[k]) + float(weights @ grams[k] @ weights)
    return lost


def _solved(gram: np.ndarray, right: np.ndarray, ridge: float) -> np.ndarray:
    if not np.isfinite(ridge):
        return np.zeros_like(right)
    scale = max(float(np.trace(gram)) / len(right), 1e-300)
    return np.linalg.solve(gram + ridge * scale * np.eye(len(right)), right)


def fitted_force(ground: Ground) -> tuple[FreeForm, float]:
    """The free-form force of the fitted recordings, and the ridge that predicts a recording left out best."""
    motion, friction = ground.present.motion, ground.drive.friction
    inside = np.asarray(ground.present.joint.batch.valid) > 0
    force = ground.base_view.force[~ground.held_out]
    x = np.asarray(motion.x)
    speed = np.arcsinh(np.asarray(motion.v) / float(friction.vs))
    bend = np.asarray(motion.spring) / float(friction.Fs)
    ranges = [(float(w[inside].min()), float(w[inside].max())) for w in (x, speed, bend)]
    middle = np.array([0.5 * (low + high) for low, high in ranges])
    half = np.array([max(0.5 * (high - low), 1e-12) for low, high in ranges])
    grams, rights, powers = [], [], []
    for row in range(x.shape[0]):
        chosen = np.flatnonzero(inside[row])[::5]
        roofs = features(np, x[row, chosen], speed[row, chosen], bend[row, chosen], middle, half)
        missing = -np.nan_to_num(force[row, chosen])  # an opposing force
        grams.append(roofs.T @ roofs)
        rights.append(roofs.T @ missing)
        powers.append(float(missing @ missing))
    ridge = min(_RIDGES, key=lambda value: _left_out(grams, rights, powers, value))
    weights = _solved(np.sum(grams, axis=0), np.sum(rights, axis=0), ridge)
    return FreeForm(jnp.asarray(weights), jnp.asarray(middle), jnp.asarray(half)), float(ridge)


def free_form(ground: Ground) -> dict:
    """Held-out errors 0.1 s ahead of the base model and of the base model with the free-form force, position units."""
    effect, ridge = fitted_force(ground)
    seen = ground.seen_by(ground.drive.with_effects(effect))
    slowest = float(np.max(np.asarray(ground.batch.dt)))
    errors = {}
    for row, recording in enumerate(ground.recordings):
        judged = slice(max(round(0.1 / slowest), 1), recording.x.size)
        if recording.role == "holdout":
            both = [
                float(np.sqrt(np.mean((model.ahead[row, judged] - recording.x[judged]) ** 2)))
                for model in (ground.base_view, seen)
            ]
            errors[recording.name] = [value if np.isfinite(value) else None for value in both]
    return {"named": None, "ridge": ridge if np.isfinite(ridge) else None, "holdout": errors}
