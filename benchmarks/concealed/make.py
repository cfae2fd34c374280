"""`make`: draw a batch, simulate it, write the cases and seal what they conceal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.concealed.composition import Plan, compose
from benchmarks.concealed.reality import RANDOM, STRENGTHS, SimulatedCase, make_case, visibility, write_case
from benchmarks.concealed.seal import close, digest_of_case

HORIZON = 0.1
"""How far ahead predictions look, s: as far as the verdict's `prediction_rmse`."""

VISIBLE = 0.5
"""By how much a strong effect changes the held-out prediction at least, over the errors of the best possible one; a
medium or weak effect by its share of that."""


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


def _seen(plan: Plan) -> tuple[Plan, dict[str, float]]:
    """The plan with the first machine on which everything it conceals is visible, and how visible each effect is. Of
    `plan.attempts` machines that do not show it, the one that comes nearest. What is random at every moment no model
    predicts, and it is not measured."""
    if plan.attempts == 1 or not set(plan.missing) - set(RANDOM):
        return plan, {}
    best, found = plan, {}
    for attempt in range(plan.attempts):
        own = replace(plan, seed=plan.seed + attempt)
        shown = visibility(own.seed, own.missing, own.strength, own.families, own.rate, HORIZON)
        if not found or min(shown.values()) > min(found.values()):
            best, found = own, shown
        if min(found.values()) >= VISIBLE * STRENGTHS[plan.strength]:
            break
    return best, found


def _case(plan: Plan, folder: Path) -> dict:
    """Write one case; returns its truth."""
    plan, visible = _seen(plan)
    case = simulated(plan.plain())
    write_case(case, folder)
    own = {key: case.truth[key] for key in ("sizes", "base", "process_noise", "sensor_noise", "kind")}
    given = {"given": case.given, "visible": visible}
    return plan.plain() | own | given | {"files": digest_of_case(folder)}


def make(cases: int, seed: int, batch: Path, families: Sequence[str] = ()) -> str:
    """Make a `batch` of `cases` from a `seed` in a new folder, of the given `families` of experiments (none: the usual
    ones); returns the hash of its truth.

    Raises `FileExistsError` when the folder is there and not empty, `UnknownFamily` for a name that is none.
    """
    if batch.exists() and any(batch.iterdir()):
        raise FileExistsError(f"{batch} is not empty; give a new folder, so that no two batches mix.")
    truths = {}
    for number, plan in enumerate(compose(cases, seed, families), start=1):
        name = name_of(number)
        truths[name] = _case(plan, batch / "cases" / name)
        sys.stderr.write(f"\rmade {number} of {cases}")
        sys.stderr.flush()
    sys.stderr.write("\n")
    return close(batch, {"schema": "frictionjax.concealed/1", "seed": seed, "cases": truths})
