"""95 % intervals of what a batch measures: Wilson's for shares, the bootstrap for everything else."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

_Z = 1.959964


def wilson(hits: int, of: int) -> tuple[float, float]:
    """Wilson's score interval of a share; (0, 1) where nothing was counted."""
    if of == 0:
        return 0.0, 1.0
    share, z2 = hits / of, _Z**2
    centre = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z / (1 + z2 / of) * float(np.sqrt(share * (1 - share) / of + z2 / (4 * of**2)))
    # Rounding must not push an end past the share itself.
    return max(min(centre - half, share), 0.0), min(max(centre + half, share), 1.0)


def share(hits: Sequence[bool]) -> dict:
    """Share of hits with its interval and counts."""
    low, high = wilson(sum(hits), len(hits))
    value = sum(hits) / len(hits) if hits else None
    return {"value": value, "low": low, "high": high, "hits": int(sum(hits)), "of": len(hits)}


def bootstrapped(items: Sequence, statistic: Callable[[list], float], draws: int = 2000) -> dict:
    """`statistic` of the `items`, with the percentile interval over draws of whole items; fixed seed."""
    if len(items) == 0:
        return {"value": None, "low": None, "high": None, "of": 0}
    rng = np.random.default_rng(20020301)
    picks = rng.integers(len(items), size=(draws, len(items)))
    drawn = [statistic([items[i] for i in row]) for row in picks]
    finite = [value for value in drawn if np.isfinite(value)]
    value = float(statistic(list(items)))
    if not finite or not np.isfinite(value):
        return {"value": None, "low": None, "high": None, "of": len(items)}
    low, high = np.quantile(finite, [0.025, 0.975])
    return {"value": value, "low": float(low), "high": float(high), "of": len(items)}


def median(items: Sequence[float]) -> dict:
    """Median with its bootstrap interval."""
    return bootstrapped(list(items), lambda some: float(np.median(some)))
