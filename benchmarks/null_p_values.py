"""`python -m benchmarks.null_p_values [--machines N] [--first SEED]`: are the p-values of effects those of chance.

Machines of `benchmarks.concealed.reality` that hide nothing: every effect of the catalogue is tested against the fitted
base model, as a diagnosis does it, and how often p-values fall below a level is counted.
"""

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np

import frictionjax as fj
from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from frictionjax.core import keep_compiled
from frictionjax.diagnosis.base_model.fit_base import base_of
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.diagnosis.screening.try_catalogue import try_catalogue
from frictionjax.diagnosis.selection.candidate_table import effect_p_values
from frictionjax.estimation.scales import plant_scales

LEVELS = (0.05, 0.01, 0.001)


def p_values(seed: int, executor: ThreadPoolExecutor) -> tuple[list[float], dict[str, float]]:
    """p-values of the single tests before one machine, and of its effects (times the number of their tests)."""
    simulated = make_case(seed, missing=(), strength="strong")
    base = base_of(starting_point(case_of(simulated)), executor, lambda *_: None)
    scales = plant_scales(base.judgement.drive, base.posterior.batch)
    trials = try_catalogue(base, scales, executor, frozenset())[0]
    return [trial.p_value for trial in trials], effect_p_values(trials)


def main() -> None:
    """Test, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=30)
    parser.add_argument("--first", type=int, default=1100)
    arguments = parser.parse_args()
    fj.configure_jax()
    keep_compiled()
    single, smallest = [], []
    with ThreadPoolExecutor(2) as executor:
        for number in range(arguments.machines):
            tests, effects = p_values(arguments.first + number, executor)
            single += tests
            smallest.append(min(1.0, min(effects.values()) * len(effects)))
            jax.clear_caches()  # programs are of the machine's lengths: kept, they would fill the memory
            sys.stderr.write(f"\r{number + 1} of {arguments.machines} machines")
    sys.stderr.write("\n")
    sys.stdout.write("| p below | single tests | machines with some effect (Bonferroni) |\n|---|---|---|\n")
    for level in LEVELS:
        tests, machines = np.mean(np.array(single) < level), np.sum(np.array(smallest) < level)
        sys.stdout.write(f"| {level:g} | {100 * tests:.1f} % | {machines} of {len(smallest)} |\n")


if __name__ == "__main__":
    main()
