"""`python -m benchmarks.ceiling CASE.toml ...`: how much a free force would explain beside the base model of cases.

A row for each case: the misfit of its held-out recordings above sensor noise, of the base model and with the free
force, the lead of the latter in standard errors, its size, and in what it is free
(`frictionjax/diagnosis/findings/ceiling.py`).
"""

import sys
import time
import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import frictionjax as fj
from frictionjax.core import silent
from frictionjax.diagnosis.base_model.fit_base import base_of
from frictionjax.diagnosis.evidence.model import scene_of
from frictionjax.diagnosis.findings.ceiling import ceiling_of
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.diagnosis.verdict import Ceiling


def above_base(case: fj.Case) -> Ceiling | None:
    """The ceiling above the base model of a `case`; None where its motion is imposed."""
    starting = starting_point(case)
    with ThreadPoolExecutor(2) as executor:
        model = base_of(starting, executor, silent)
    since = np.array([recording.start_time or 0.0 for recording in starting.recordings])
    return ceiling_of(model, scene_of(model, starting.names), since)[0]


def main(paths: list[str]) -> None:
    """Print a table for the cases in the files `paths`."""
    fj.configure_jax()
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    print(
        "| case | base model | with the free force | lead | force over Coulomb friction | free in | above | s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for path in paths:
        case, start = fj.load_case(path), time.perf_counter()
        found = above_base(case)
        seconds = time.perf_counter() - start
        if found is None:
            print(f"| {case.name} | imposed motion | | | | | | {seconds:.0f} |", flush=True)
            continue
        print(
            f"| {case.name} | {found.misfit_model:.3g} | {found.misfit_free:.3g} | {found.lead:.2g} | "
            f"{100 * found.of_coulomb:.2g} % | {found.variable} | {'yes' if found.above else 'no'} | {seconds:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
