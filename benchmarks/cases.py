"""Diagnose case files one after the other and print a table: verdict, p-values, held-out error, seconds.

    python benchmarks/cases.py CASE.toml [CASE.toml ...] [--out DIR]

Each case runs as a process of its own, as a user would run it, compilation included.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path


def row(case: Path, out: Path) -> str:
    """One line of the table for `case`, whose results go to a folder of its own under `out`."""
    folder = out / (case.parent.name if case.name == "case.toml" else case.stem)
    start = time.perf_counter()
    command = [sys.executable, "-m", "frictionjax", "diagnose", str(case), "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - start
    if done.returncode:
        return f"| {folder.name} | exit status {done.returncode}: {done.stderr.strip().splitlines()[-1]} |"
    verdict = json.loads((folder / "verdict.json").read_text())
    named = ", ".join(
        f"{m['effect']} ({'/'.join(m['class'])}; p = {m['p_value']:.1g})" for m in verdict["missing"]
    )
    errors = "; ".join(
        f"{name} {fit['base']['prediction_rmse']:.3g} -> {fit['extended']['prediction_rmse']:.3g}"
        f" (free run {fit['base']['free_run_rmse']:.3g} -> {fit['extended']['free_run_rmse']:.3g})"
        for name, fit in verdict["fit"].items()
        if fit["role"] == "holdout"
    )
    best = min((c["p_value"] for c in verdict["candidates"] if c["p_value"] is not None), default=None)
    J = verdict["base"]["parameters"]["J"]["value"]
    J_extended = verdict["extended"]["parameters"]["J"]["value"]
    return (
        f"| {folder.name} | {verdict['verdict']} | {named or 'nothing'} | {best:.1g} | {errors} | "
        f"{J:.5g} / {J_extended:.5g} | {seconds:.0f} ({verdict['seconds']['compile']:.0f}) |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("out/cases"))
    arguments = parser.parse_args()
    sys.stdout.write(
        "| case | verdict | named | smallest p of any effect | held-out error 0.1 s ahead, base -> extended "
        "(position units) | J base / extended | s (compile, both threads) |\n|---|---|---|---|---|---|---|\n"
    )
    for case in arguments.cases:
        sys.stdout.write(row(case, arguments.out) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
