"""Rival (a): the effect whose column explains most of the residual, base parameters held where the base fit left them.

What the base parameters would absorb is not projected out: the usual shortcut.
"""

from __future__ import annotations

import numpy as np

from benchmarks.concealed.rivals.ground import Column, Ground

LEAST_R2 = 0.05
"""Share of the residual below which nothing is named: a round number, tuned on nothing."""


def r2_of(column: Column, e: np.ndarray, weight: np.ndarray) -> float:
    """Share of the weighted power of `e`, shape `(r, n)`, that a regression on the column explains."""
    flat = column.values.reshape(column.values.shape[0], -1)
    weighted = flat * weight.ravel()
    gram, right = weighted @ flat.T, weighted @ e.ravel()
    return float(right @ np.linalg.lstsq(gram, right, rcond=None)[0] / np.sum(weight * e**2))


def by_largest_r2(ground: Ground) -> dict:
    """The name with the largest R2, or none; and the largest R2 of every effect."""
    e = np.nan_to_num(np.asarray(ground.present.e))
    weight = np.asarray(ground.present.weighings[0].weight)
    best: dict[str, float] = {}
    for column in ground.columns:
        best[column.effect] = max(best.get(column.effect, 0.0), r2_of(column, e, weight))
    first = max(best, key=lambda name: best[name], default="")
    named = first if first and best[first] > LEAST_R2 else None
    ranked = sorted(best.items(), key=lambda item: -item[1])[:5]
    return {"named": named, "r2": {name: round(value, 5) for name, value in ranked}}
