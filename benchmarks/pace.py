"""`python -m benchmarks.pace CASE.toml ...`: how fast the recordings of cases are observed, and why.

A row for each recording: noise of its sensor, the bandwidth that a Kalman filter has for a free mass under it, and the
bandwidth of the observer that a diagnosis begins with, in Hz (`frictionjax/diagnosis/evidence/pace.py`).
"""

import sys
import warnings

import numpy as np

import frictionjax as fj
from frictionjax.diagnosis.evidence.pace import free_mass_bandwidth, pace_of
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.diagnosis.rule import Rule
from frictionjax.estimation.objective.robust import SLOW_BANDWIDTH


def rows(case: fj.Case) -> list[tuple[str, float, float, float]]:
    """Name, noise, bandwidth for a free mass and bandwidth of the observer of each recording of a `case`."""
    starting, rule = starting_point(case), Rule()
    drive, batch = starting.start.drives[0], starting.batch
    free = free_mass_bandwidth(drive, batch, rule)  # type: ignore[arg-type]
    pace = pace_of(drive, batch, starting.held_out, rule=rule)
    used = np.minimum(SLOW_BANDWIDTH * pace, 0.1 / np.asarray(batch.dt))
    return [
        (name, float(noise), float(one), float(other))
        for name, noise, one, other in zip(starting.names, batch.noise, free, used, strict=True)
    ]


def main(paths: list[str]) -> None:
    """Print a table for the cases in the files `paths`."""
    fj.configure_jax()
    warnings.simplefilter("ignore", category=fj.core.FrictionjaxWarning)
    print("| case | recording | noise | free mass, Hz | observer, Hz |\n|---|---|---|---|---|")
    for path in paths:
        case = fj.load_case(path)
        unit = case.plant.position_unit
        for name, noise, free, used in rows(case):
            print(f"| {case.name} | {name} | {noise:.2g} {unit} | {free:.3g} | {used:.3g} |")


if __name__ == "__main__":
    main(sys.argv[1:])
