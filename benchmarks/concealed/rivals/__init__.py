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
    base = {k: p["value"] for k, p in verdict["base"]["parameters"].items()}
    if None in base.values():
        return {"failed": "the base model has a parameter that is not a number"}
    ground, said = ground_of(case, base), {}
    asked = dict(RIVALS)
    if bic_seconds > 0.0:
        asked["bic"] = lambda ground: by_bic(ground, bic_seconds)
    for name, rival in asked.items():
        start = time.perf_counter()
        try:
            found = rival(ground)
        except (
            ValueError,
            FloatingPointError,
        ) as error:  # a singular matrix, a trajectory that is not finite
            found = {"failed": str(error)}
        said[name] = found | {"seconds": round(time.perf_counter() - start, 2)}
    return said
