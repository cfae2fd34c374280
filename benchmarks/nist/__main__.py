"""`python -m benchmarks.nist [NAME ...] [--data FOLDER]`: the 27 nonlinear regression problems of NIST's Statistical
Reference Datasets from both starts, by the least squares of `fit` and by scipy's, in correct digits.

The files are looked for in the folder, or where the environment variable FRICTIONJAX_DATA says; what is absent is
named, with where to get it.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.nist.descents import Ended, alone, as_fit, by_scipy
from benchmarks.nist.models import MODELS
from benchmarks.nist.problems import Problem, all_problems
from frictionjax.core import InputError, configure_jax

CERTIFIED_DIGITS = 11
SOLVED = 4.0
"""Correct digits of every parameter from which on a problem counts as solved."""

HEAD = """| problem | difficulty | start | as `fit`: digits | error, standard deviations | evaluations | \
solver alone: digits | evaluations | scipy lm: digits | evaluations | scipy trf: digits | evaluations |
|---|---|---|---|---|---|---|---|---|---|---|---|"""


def digits(found: Float[np.ndarray, " p"], certified: Float[np.ndarray, " p"]) -> float:
    """Correct digits of the worst of the parameters `found`: minus the decimal logarithm of the relative error, between
    0 and the number of digits that are `certified`."""
    with np.errstate(divide="ignore"):
        each = -np.log10(np.abs(found - certified) / np.abs(certified))
    return float(np.clip(np.min(np.where(np.isnan(each), 0.0, each)), 0.0, CERTIFIED_DIGITS))


SOLVERS: dict[str, Callable[[Problem, Float[np.ndarray, " p"]], Ended]] = {
    "as `fit`": as_fit,
    "solver alone": alone,
    "scipy lm": lambda problem, start: by_scipy(problem, start, "lm"),
    "scipy trf": lambda problem, start: by_scipy(problem, start, "trf"),
}


def error(problem: Problem, ended: Ended) -> float:
    """Error of the worst parameter, over its certified standard deviation."""
    return float(np.max(np.abs(ended.parameters - problem.certified) / problem.deviations))


def row(problem: Problem, number: int, ended: dict[str, Ended]) -> str:
    """The row of a `problem` from start `number` (0 or 1), where each of `SOLVERS` `ended`."""
    cells = [problem.name, problem.level.lower(), str(number + 1)]
    for solver, one in ended.items():
        cells.append(f"{digits(one.parameters, problem.certified):.1f}")
        if solver == "as `fit`":
            cells.append(f"{error(problem, one):.2g}")
        cells.append(str(one.evaluations))
    return f"| {' | '.join(cells)} |"


def summary(
    solved: dict[str, list[float]], errors: dict[str, list[float]], evaluations: dict[str, list[int]]
) -> str:
    """How many problems each solver `solved` (their digits), how many have `errors` below one standard deviation, and
    medians of the digits of those solved and of the `evaluations`."""
    lines = []
    for solver, found in solved.items():
        right = np.array(found) >= SOLVED
        middle = f"{np.median(np.array(found)[right]):.1f}" if np.any(right) else "-"
        lines.append(
            f"{solver}: {np.sum(right)} of {right.size} to {SOLVED:.0f} digits or more, these to {middle} digits in "
            f"the median; {np.sum(np.array(errors[solver]) < 1.0)} within a standard deviation; "
            f"{np.median(evaluations[solver]):.0f} evaluations in the median."
        )
    return "\n".join(lines)


def parsed(arguments: list[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.nist",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", choices=[*MODELS, []], metavar="NAME", help=", ".join(MODELS))
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="with the files; subfolders are searched")
    return parser.parse_args(arguments)


def main() -> int:
    """Print a row for each problem and start, and what each solver solved."""
    options = parsed()
    configure_jax()
    try:
        problems = all_problems(None if options.data is None else [options.data], options.names or MODELS)
    except InputError as absent:
        sys.stderr.write(f"{absent}\n")
        return 1
    solved: dict[str, list[float]] = {solver: [] for solver in SOLVERS}
    errors: dict[str, list[float]] = {solver: [] for solver in SOLVERS}
    evaluations: dict[str, list[int]] = {solver: [] for solver in SOLVERS}
    print(HEAD)
    for problem in problems:
        for number, start in enumerate(problem.starts):
            ended = {solver: run(problem, start) for solver, run in SOLVERS.items()}
            print(row(problem, number, ended), flush=True)
            for solver, one in ended.items():
                solved[solver].append(digits(one.parameters, problem.certified))
                errors[solver].append(error(problem, one))
                evaluations[solver].append(one.evaluations)
    print(f"\n{summary(solved, errors, evaluations)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
