"""Rival (b): every candidate refitted with all parameters free, the smallest Bayesian information criterion wins.

Costly: each structure is compiled and descended. The candidates go in the order of their R2 until the time is up.
"""

from __future__ import annotations

import time

import jax.numpy as jnp
import numpy as np

from benchmarks.concealed.rivals.ground import Ground
from benchmarks.concealed.rivals.largest_r2 import r2_of
from frictionjax.estimation.descent.robust import RobustFit, descend
from frictionjax.estimation.objective.posterior import Posterior

_STEPS = 6


def criterion(posterior: Posterior, fitted: RobustFit) -> float:
    """BIC: twice the negative log-likelihood, plus log n for each parameter."""
    rows = np.asarray(posterior.fitted[0])[:, None]
    samples = float(np.sum(np.asarray(posterior.batch.block_count) * rows))
    return 2.0 * fitted.misfit * samples + len(posterior.layout) * float(np.log(samples))


def by_bic(ground: Ground, seconds: float) -> dict:
    """The name with the smallest BIC among those refitted within `seconds`, or none where the base model has it."""
    until = time.perf_counter() + seconds
    e, weight = np.nan_to_num(np.asarray(ground.present.e)), np.asarray(ground.present.weighings[0].weight)
    best = {}
    for column in ground.columns:
        value, key = r2_of(column, e, weight), type(column.form).__name__
        if key not in best or value > best[key][0]:
            best[key] = value, column
    ordered = sorted(best.values(), key=lambda pair: -pair[0])
    posterior, start = ground.present.posterior, ground.present.vector
    found = {"": criterion(posterior, descend(posterior, start, graduate=False, steps=_STEPS))}
    tried = 0
    for _, column in ordered:
        if time.perf_counter() > until:
            break
        fitted = descend(column.posterior, jnp.asarray(column.vector), graduate=False, steps=_STEPS)
        value = criterion(column.posterior, fitted)
        found[column.effect] = min(value, found.get(column.effect, np.inf))
        tried += 1
    first = min(found, key=lambda name: found[name])
    ranked = sorted(found.items(), key=lambda item: item[1])[:5]
    finite = {name or "base": round(value, 1) for name, value in ranked if np.isfinite(value)}
    return {"named": first or None, "bic": finite, "tried": tried, "of": len(ordered)}
