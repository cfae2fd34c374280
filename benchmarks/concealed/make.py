"""`make`: draw a batch, simulate it, write the cases and seal what they conceal."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.concealed.composition import Plan, compose
from benchmarks.concealed.reality import SimulatedCase, make_case, write_case
from benchmarks.concealed.seal import close, digest_of_case

HORIZON = 0.1
"""How far ahead predictions look, s: as far as the verdict's `prediction_rmse`."""


def name_of(number: int) -> str:
    """Name of a case, and of its folder."""
    return f"case_{number:03d}"


def simulated(plan: dict, *, horizon: float = 0.0) -> SimulatedCase:
    """The case of a plan (as in the truth), simulated; the same every time. With a `horizon` (s) it predicts."""
    return make_case(
        plan["seed"],
        tuple(plan["missing"]),
        plan["strength"],
        families=plan["families"],
        rate=plan["rate"],
        stretch=plan["stretch"],
        coloured=plan["coloured"],
        horizon=horizon,
    )


def _case(plan: Plan, folder: Path) -> dict:
    """Write one case; returns its truth."""
    case = simulated(plan.plain())
    write_case(case, folder)
    own = {key: case.truth[key] for key in ("sizes", "base", "process_noise", "sensor_noise", "kind")}
    return plan.plain() | own | {"files": digest_of_case(folder)}


def make(cases: int, seed: int, batch: Path) -> str:
    """Make a `batch` of `cases` from a `seed` in a new folder; returns the hash of its truth.

    Raises `FileExistsError` when the folder is there and not empty.
    """
    if batch.exists() and any(batch.iterdir()):
        raise FileExistsError(f"{batch} is not empty; give a new folder, so that no two batches mix.")
    truths = {}
    for number, plan in enumerate(compose(cases, seed), start=1):
        name = name_of(number)
        truths[name] = _case(plan, batch / "cases" / name)
        sys.stderr.write(f"\rmade {number} of {cases}")
        sys.stderr.flush()
    sys.stderr.write("\n")
    return close(batch, {"schema": "frictionjax.concealed/1", "seed": seed, "cases": truths})
