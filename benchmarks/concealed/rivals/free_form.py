"""Rival (d): a free-form model of the residual force in x, v and z; it predicts, and cannot name.

Piecewise linear in asinh(v/vs) and z on one grid, in x on another, and in x for each direction; robust regression on
the fitted recordings with a penalty on curvature. Its strength, and whether x takes part, is chosen by leaving out
every sixth second in turn.
"""

from __future__ import annotations

from functools import cache
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.concealed.rivals.ground import Ground
from frictionjax.core import Parameter
from frictionjax.physics import LuGre
from frictionjax.physics.effects import About, AbstractForceEffect, Now

_SPEEDS, _BENDS, _PLACES = 17, 5, 16
_BOTH = _SPEEDS * _BENDS
_PENALTIES = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
_FOLDS = 6


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


def _curvature(count: int) -> np.ndarray:
    second = np.diff(np.eye(count), 2, axis=0)
    return second.T @ second


@cache
def _penalty() -> np.ndarray:
    """Squares of the second differences along every axis, shape `(k, k)`, and a little of the squares themselves."""
    k = _BOTH + 2 * _PLACES
    whole = 1e-4 * np.eye(k)
    both = np.kron(_curvature(_SPEEDS), np.eye(_BENDS)) + np.kron(np.eye(_SPEEDS), _curvature(_BENDS))
    whole[:_BOTH, :_BOTH] += both
    for first in (_BOTH, _BOTH + _PLACES):
        whole[first : first + _PLACES, first : first + _PLACES] += _curvature(_PLACES)
    return whole


def _solved(gram: np.ndarray, right: np.ndarray, penalty: float, count: int) -> np.ndarray:
    """Weights of the first `count` roofs, zero for the others."""
    gram, right_own = gram[:count, :count], right[:count]
    scale = max(float(np.trace(gram)) / count, 1e-300)
    weights = np.linalg.solve(gram + penalty * scale * _penalty()[:count, :count], right_own)
    return np.concatenate([weights, np.zeros(len(right) - count)])


def _left_out(grams: np.ndarray, rights: np.ndarray, choice: tuple[float, int]) -> float:
    """Sum of squares of each fold, predicted from the others, beside that of no force at all."""
    lost = 0.0
    for gram, right in zip(grams, rights, strict=True):
        weights = _solved(grams.sum(axis=0) - gram, rights.sum(axis=0) - right, *choice)
        lost += float(weights @ gram @ weights - 2.0 * weights @ right)
    return lost


def fitted_force(ground: Ground) -> tuple[FreeForm, tuple[float, int] | None]:
    """The free-form force of the fitted recordings, and penalty and number of roofs that predict best what is left out
    (None when no force at all predicts better)."""
    motion, friction = ground.present.motion, ground.drive.friction
    inside = np.asarray(ground.present.posterior.batch.valid) > 0
    force = ground.base_view.force[~ground.held_out]
    dt = np.asarray(ground.present.posterior.batch.dt)
    x = np.asarray(motion.x)
    speed = np.arcsinh(np.asarray(motion.v) / float(friction.vs))
    bend = np.asarray(motion.spring) / float(friction.Fs)
    ranges = [(float(w[inside].min()), float(w[inside].max())) for w in (x, speed, bend)]
    middle = np.array([0.5 * (low + high) for low, high in ranges])
    half = np.array([max(0.5 * (high - low), 1e-12) for low, high in ranges])
    count = _BOTH + 2 * _PLACES
    grams, rights = np.zeros((_FOLDS, count, count)), np.zeros((_FOLDS, count))
    usual = max(float(np.quantile(np.abs(force[inside]), 0.95)), 1e-300)
    for row in range(x.shape[0]):
        chosen = np.flatnonzero(inside[row])[::5]
        roofs = features(np, x[row, chosen], speed[row, chosen], bend[row, chosen], middle, half)
        missing = -np.nan_to_num(force[row, chosen])  # an opposing force
        # A few transients, a hundred times what is usual, must not outvote the rest.
        weighted = roofs / (1.0 + (missing / usual) ** 2)[:, None]
        fold = (chosen * dt[row]).astype(int) % _FOLDS
        for k in range(_FOLDS):
            grams[k] += weighted[fold == k].T @ roofs[fold == k]
            rights[k] += weighted[fold == k].T @ missing[fold == k]
    choices = [(penalty, roofs) for roofs in (_BOTH, count) for penalty in _PENALTIES]
    best = min(choices, key=lambda choice: _left_out(grams, rights, choice))
    helps = _left_out(grams, rights, best) < 0.0
    weights = _solved(grams.sum(axis=0), rights.sum(axis=0), *best) if helps else np.zeros(count)
    effect = FreeForm(jnp.asarray(weights), jnp.asarray(middle), jnp.asarray(half))
    return effect, best if helps else None


def free_form(ground: Ground) -> dict:
    """Held-out errors 0.1 s ahead of the base model and of the base model with the free-form force, position units."""
    effect, chosen = fitted_force(ground)
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
    return {"named": None, "penalty_and_roofs": chosen, "holdout": errors}
