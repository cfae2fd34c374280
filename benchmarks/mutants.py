"""`python -m benchmarks.mutants`: every number of the rule changed by a half, and whether a test of the rule sees it.

A number with which nothing changes could as well be another one. Prints a row for each number; fails where one
survives.
"""

import importlib
import sys
from pathlib import Path

from frictionjax.diagnosis.rule import Rule

SUPPORT = Path(__file__).parents[1] / "tests" / "support"
FACTORS = (0.5, 1.5)


def killed_by(name: str, factor: float) -> list[str]:
    """Numbers of the rule whose tests fail where the number `name` is `factor` times what it is."""
    helpers = importlib.import_module("helpers_rule")
    today = Rule()
    other = today.changed({name: factor * today.numbers()[name]})
    return [
        one
        for one, probes in helpers.PROBES.items()
        if any(helpers.answer(probe, other) != expected for probe, expected in probes)
    ]


def main() -> None:
    """Change, and print."""
    sys.path.insert(0, str(SUPPORT))
    survivors = 0
    print("| number | value | times | tests that fail |\n|---|---|---|---|")
    for name, value in Rule().numbers().items():
        for factor in FACTORS:
            found = killed_by(name, factor)
            survivors += not found
            print(f"| {name} | {value:g} | {factor:g} | {', '.join(found) or 'SURVIVES'} |")
    print(f"\n{len(Rule().numbers()) * len(FACTORS)} mutants, {survivors} survive.")
    if survivors:
        sys.exit(1)


if __name__ == "__main__":
    main()
