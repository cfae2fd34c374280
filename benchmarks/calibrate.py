"""`python -m benchmarks.calibrate FIT ... [--check OTHER ...]`: what makes a confidence a probability.

Reads the lines of `benchmarks.bank` (.jsonl) and the results of a revealed batch (.json): every effect that was
accepted, with the true one in the catalogue, with it left out, and outside the catalogue. Prints the weights of
`frictionjax.diagnosis.confidence`, how well they do on the machines that they were fitted to, and on others.
"""

import argparse
import itertools
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from frictionjax.diagnosis.confidence import Evidence

_RIDGE = 0.05
_BINS = (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)


def read(paths: list[Path]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Features `(n, 4)`, right or wrong `(n,)`, and what each was, of all accepted effects."""
    features, right, what = [], [], []
    for path in paths:
        for missing, label, names, evidence in _of_batch(path) if path.suffix == ".json" else _of_bank(path):
            for name, numbers in zip(names, evidence, strict=True):
                features.append(Evidence(*numbers).features)
                right.append(name in missing and not label)
                what.append(f"{label}{','.join(missing) or 'nothing'} as {name}")
    return np.array(features).reshape(-1, 4), np.array(right, bool), what


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


def fitted(features: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Bias and weights by maximum likelihood with a weak ridge, shape `(5,)`; weights are not negative."""
    columns = np.column_stack([np.ones(len(right)), features])

    def loss(weights):
        margin = np.where(right, 1.0, -1.0) * (columns @ weights)
        return np.sum(np.logaddexp(0.0, -margin)) + _RIDGE * np.sum(weights[1:] ** 2)

    return minimize(loss, np.array([0.0, 0.5, 0.5, 0.5, 0.5]), bounds=[(None, None)] + [(0.0, None)] * 4).x


def reliability(probability: np.ndarray, right: np.ndarray, write) -> None:
    """Table of stated against true frequency, with the Brier score and that of the base rate."""
    write("| stated | cases | mean stated | right |")
    write("|---|---|---|---|")
    for low, high in itertools.pairwise(_BINS):
        inside = (probability >= low) & ((probability < high) | (high == 1.0))
        if np.any(inside):
            write(
                f"| {low:g} to {high:g} | {inside.sum()} | {probability[inside].mean():.2f} | "
                f"{right[inside].mean():.2f} |"
            )
    brier, base = np.mean((probability - right) ** 2), right.mean() * (1.0 - right.mean())
    write(f"\nBrier score {brier:.3f}; of the base rate alone {base:.3f}.")


def main() -> None:
    """Fit, print, check."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fit", nargs="+", type=Path)
    parser.add_argument("--check", nargs="*", type=Path, default=[])
    arguments = parser.parse_args()

    def write(text: str) -> None:
        sys.stdout.write(text + "\n")

    features, right, what = read(arguments.fit)
    weights = fitted(features, right)
    write(
        f"{right.sum()} right, {(~right).sum()} wrong names; bias {weights[0]:.2f}, weights {np.round(weights[1:], 2)}"
    )

    def stated(features: np.ndarray) -> np.ndarray:
        return 1.0 / (1.0 + np.exp(-(weights[0] + features @ weights[1:])))

    reliability(stated(features), right, write)
    for name, p, good in sorted(zip(what, stated(features), right, strict=True), key=lambda item: item[1]):
        if (p > 0.5) != good:
            write(f"- {name}: stated {p:.2f}, {'right' if good else 'wrong'}")
    if arguments.check:
        write("\nOn other machines:\n")
        features, right, _ = read(arguments.check)
        reliability(stated(features), right, write)


if __name__ == "__main__":
    main()
