"""`python -m benchmarks.calibrate FIT ... [--check OTHER ...]`: what makes a confidence a probability.

Reads the lines of `benchmarks.bank` (.jsonl) and the results of a revealed batch (.json): every effect that was
accepted, with the true one in the catalogue, with it left out, and outside the catalogue. A name's chance to be right
hangs on how often physics is met that the catalogue lacks: the machines of the fit are weighed so that one in five of
those that lack something lacks that, as in the batches (`--outside`). Prints the weights of
`frictionjax.diagnosis.confidence`, how well they do on the machines that they were fitted to, and on others.
"""

import argparse
import itertools
import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from benchmarks.concealed.reality import CATALOGUE
from frictionjax.diagnosis.selection.confidence import Evidence

_RIDGE = 0.05
_BINS = (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)


class Names(NamedTuple):
    """All accepted effects: features `(n, 4)`, right or wrong `(n,)`, weight in the fit `(n,)`, and what each was."""

    features: np.ndarray
    right: np.ndarray
    weight: np.ndarray
    what: list[str]


def read(paths: list[Path], outside: float | None = None) -> Names:
    """The names given to the machines in the files at `paths`; of machines that lack something a share `outside` is
    to lack what the catalogue does not have (None: as they are)."""
    features, right, foreign, what, machines = [], [], [], [], Counter()
    for path in paths:
        for missing, label, names, evidence in _of_batch(path) if path.suffix == ".json" else _of_bank(path):
            out = bool(label) or any(name not in CATALOGUE for name in missing)
            machines[out] += bool(missing)
            for name, numbers in zip(names, evidence, strict=True):
                features.append(Evidence(*numbers).features)
                right.append(name in missing and not label)
                foreign.append(out)
                what.append(f"{label}{','.join(missing) or 'nothing'} as {name}")
    weight = np.ones(len(right))
    if outside is not None:
        weight[np.array(foreign, bool)] = outside / (1.0 - outside) * machines[False] / max(machines[True], 1)
    return Names(np.array(features).reshape(-1, 4), np.array(right, bool), weight, what)


_Said = tuple[list[str], str, list[str], list[list[float]]]  # missing, label, names, evidence for each


def _of_bank(path: Path) -> Iterator[_Said]:
    for text in path.read_text(encoding="utf-8").splitlines():
        line = json.loads(text)
        for label, run in (("", line), ("left out: ", line["left"])):
            if run:
                names = [step["effect"] for step in run["steps"] if step["effect"]]
                yield line["missing"], label, names, run["evidence"]


def _of_batch(path: Path) -> Iterator[_Said]:
    for name, case in json.loads(path.read_text(encoding="utf-8"))["cases"].items():
        if "evidence" not in case:
            sys.exit(f"{path}: {name} keeps no evidence, as batches before the second; leave this file out.")
        yield case["missing"], "", case["named"], case["evidence"]


def fitted(names: Names) -> np.ndarray:
    """Bias and weights by maximum likelihood with a weak ridge, shape `(5,)`; weights are not negative."""
    columns = np.column_stack([np.ones(len(names.right)), names.features])

    def loss(weights):
        margin = np.where(names.right, 1.0, -1.0) * (columns @ weights)
        return names.weight @ np.logaddexp(0.0, -margin) + _RIDGE * np.sum(weights[1:] ** 2)

    return minimize(loss, np.array([0.0, 0.5, 0.5, 0.5, 0.5]), bounds=[(None, None)] + [(0.0, None)] * 4).x


def reliability(probability: np.ndarray, names: Names, write) -> None:
    """Table of stated against true frequency, with the Brier score and that of the base rate, all as weighed."""
    right, weight = names.right.astype(float), names.weight
    write("| stated | cases | mean stated | right |")
    write("|---|---|---|---|")
    for low, high in itertools.pairwise(_BINS):
        inside = (probability >= low) & ((probability < high) | (high == 1.0))
        if np.any(inside):
            stated, found = (np.average(of[inside], weights=weight[inside]) for of in (probability, right))
            write(f"| {low:g} to {high:g} | {inside.sum()} | {stated:.2f} | {found:.2f} |")
    brier, rate = (np.average(of, weights=weight) for of in ((probability - right) ** 2, right))
    base = rate * (1.0 - rate)
    write(f"\nBrier score {brier:.3f}; of the base rate alone {base:.3f}.")


def main() -> None:
    """Fit, print, check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fit", nargs="+", type=Path)
    parser.add_argument("--check", nargs="*", type=Path, default=[])
    parser.add_argument("--outside", type=float, default=0.2, help="share that lacks what no catalogue has")
    arguments = parser.parse_args()

    def write(text: str) -> None:
        sys.stdout.write(text + "\n")

    names = read(arguments.fit, arguments.outside)
    weights, right = fitted(names), names.right
    write(
        f"{right.sum()} right, {(~right).sum()} wrong names; bias {weights[0]:.2f}, weights {np.round(weights[1:], 2)}"
    )

    def stated(features: np.ndarray) -> np.ndarray:
        return 1.0 / (1.0 + np.exp(-(weights[0] + features @ weights[1:])))

    reliability(stated(names.features), names, write)
    for name, p, good in sorted(
        zip(names.what, stated(names.features), right, strict=True), key=lambda item: item[1]
    ):
        if (p > 0.5) != good:
            write(f"- {name}: stated {p:.2f}, {'right' if good else 'wrong'}")
    if arguments.check:
        write("\nOn other machines:\n")
        others = read(arguments.check)
        reliability(stated(others.features), others, write)


if __name__ == "__main__":
    main()
