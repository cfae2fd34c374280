"""Other ways to answer the same question, under the same seal: from the cases and the base model, without a truth."""

from __future__ import annotations

import time
from collections.abc import Callable

import frictionjax as fj
from benchmarks.concealed.rivals.bic import by_bic
from benchmarks.concealed.rivals.free_form import free_form
from benchmarks.concealed.rivals.geometry import geometry
from benchmarks.concealed.rivals.ground import Ground, ground_of
from benchmarks.concealed.rivals.largest_r2 import by_largest_r2
from benchmarks.concealed.rivals.sparse import by_sparse_regression

RIVALS: dict[str, Callable[[Ground], dict]] = {
    "largest_r2": by_largest_r2,
    "sparse": by_sparse_regression,
    "free_form": free_form,
    "geometry": geometry,
}
"""Name -> what it says of a case, as plain JSON; `geometry` is no rival but the overlap of the effects' columns."""


def run_rivals(case: fj.Case, verdict: dict, bic_seconds: float = 0.0) -> dict:
    """What every rival says of a `case`, beside the base model of the `verdict`; refits by BIC only where
    `bic_seconds` gives them time."""
    ground = ground_of(case, {k: p["value"] for k, p in verdict["base"]["parameters"].items()})
    said: dict = {}
    for name, rival in RIVALS.items():
        start = time.perf_counter()
        said[name] = rival(ground) | {"seconds": round(time.perf_counter() - start, 2)}
    if bic_seconds > 0.0:
        start = time.perf_counter()
        said["bic"] = by_bic(ground, bic_seconds) | {"seconds": round(time.perf_counter() - start, 2)}
    return said
