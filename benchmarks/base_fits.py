"""`python -m benchmarks.base_fits [--families presliding odd ...] [--machines N] [--first SEED]`: does the base fit
find its minimum?

Machines of `benchmarks.concealed.reality` that hide nothing, under each family of experiments, fitted from starting
values alone, as a diagnosis begins, and from the truth. A fit from starting values that misfits more than the one from
the truth has come to rest elsewhere.
"""

import argparse
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

import frictionjax as fj
from benchmarks.bank import case_of
from benchmarks.concealed.reality import make_case
from benchmarks.concealed.reality.experiments import FAMILIES
from frictionjax.core import silent
from frictionjax.diagnosis.base_model.credibility import credibility
from frictionjax.diagnosis.base_model.fit_base import base_of, fit_base
from frictionjax.diagnosis.intake.starting_point import starting_point
from frictionjax.physics import Drive, LuGre

ELSEWHERE = 0.02
"""Misfit per sample above that of the fit from the truth, beyond which a fit has come to rest elsewhere."""


class Ended(NamedTuple):
    """Where the fits of one machine ended: misfit per sample from its `starts`, from the `truth`, and whether the first
    is `credible`."""

    starts: float
    truth: float
    credible: bool

    @property
    def found(self) -> bool:
        """Whether the fit from starting values came to rest where the one from the truth did, or lower."""
        return self.starts < self.truth + ELSEWHERE


def fitted(seed: int, family: str) -> Ended:
    """Fit the machine of a `seed` that hides nothing, under a `family` of experiments of half their length."""
    simulated = make_case(seed, missing=(), families=family, stretch=0.5)
    case, own = case_of(simulated), simulated.truth["base"]
    friction = LuGre(**{name: value for name, value in own.items() if name != "J"})
    starting = starting_point(case)
    with ThreadPoolExecutor(2) as executor:
        found = base_of(starting, executor, silent)
        true = Drive(own["J"], friction, case.plant.motor_constant)
        best = fit_base([true], starting.batch, starting.held_out, executor, silent)
    floor = np.ones((1, 1))
    starts, truth = (model.judgement.misfits(floor)[0] for model in (found, best))
    return Ended(starts, truth, credibility(found).is_credible())


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.base_fits",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    known = [name for name in FAMILIES if name != "short"]
    parser.add_argument("--families", nargs="+", default=known, choices=known)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--first", type=int, default=910001, help="seed of the first machine")
    return parser.parse_args(arguments)


def main() -> None:
    """Print a line for each family."""
    options = parsed()
    fj.configure_jax()
    print("| experiments | at the minimum | credible | largest misfit above that from the truth |")
    print("|---|---|---|---|")
    for family in options.families:
        ended = []
        for number in range(options.machines):
            ended.append(fitted(options.first + number, family))
            sys.stderr.write(f"\r{family}: {number + 1} of {options.machines}")
        sys.stderr.write("\n")
        worst = max(one.starts - one.truth for one in ended)
        found, credible = sum(one.found for one in ended), sum(one.credible for one in ended)
        print(
            f"| {family} | {found} of {len(ended)} | {credible} of {len(ended)} | {worst:.3f} |", flush=True
        )


if __name__ == "__main__":
    main()
