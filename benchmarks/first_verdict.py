"""Seconds from nothing to the first verdict on a new CSV, by the README alone: `python -m benchmarks.first_verdict`.

A fresh virtual environment with empty caches of compiled programs; pip's downloads are those of this machine. Each step
is the command that the README gives, on files of the program's own columns.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import frictionjax as fj
from benchmarks.diagnose import CASES, write
from benchmarks.timing import machine

REPOSITORY = Path(__file__).parents[1]


def seconds_of(*command: str | Path, environment: dict[str, str]) -> float:
    """Seconds of a `command`, which must succeed, in the `environment`."""
    start = time.perf_counter()
    subprocess.run([str(word) for word in command], env=environment, check=True, capture_output=True)
    return time.perf_counter() - start


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=int, default=20_000, choices=list(CASES))
    arguments = parser.parse_args()
    fj.configure_jax()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(folder / "case", *CASES[arguments.rows][0])
        *fitted, held_out = sorted((folder / "case").glob("*.csv"))
        own = {
            key: value
            for key, value in os.environ.items()
            if key not in ("JAX_COMPILATION_CACHE_DIR", "PYTHONPATH")
        }
        own["XDG_CACHE_HOME"] = str(folder / "cache")
        # pip keeps its downloads where it always does: what is measured is not the network.
        pip = own | {"XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))}
        binaries = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        asked = ("diagnose", *fitted, "--holdout", held_out, "--out", folder / "out")
        steps = (
            ("a virtual environment", (sys.executable, "-m", "venv", folder / "venv"), own),
            ("`pip install .`", (binaries / "python", "-m", "pip", "install", "--quiet", REPOSITORY), pip),
            ("`frictionjax --help`", (binaries / "frictionjax", "--help"), own),
            (
                "`frictionjax check`",
                (
                    binaries / "frictionjax",
                    "check",
                    *fitted,
                    "--holdout",
                    held_out,
                    "--picture",
                    folder / "seen.png",
                ),
                own,
            ),
            ("`frictionjax diagnose`, the first", (binaries / "frictionjax", *asked), own),
            ("`frictionjax diagnose`, again", (binaries / "frictionjax", *asked), own),
        )
        print(json.dumps(machine()))
        print(f"| {arguments.rows} rows, {len(fitted) + 1} files | seconds |\n|---|---|")
        for what, command, environment in steps:
            print(f"| {what} | {seconds_of(*command, environment=environment):.1f} |", flush=True)
        verdict = json.loads((folder / "out" / "verdict.json").read_text(encoding="utf-8"))
    print(f"\n{verdict['summary']}")


if __name__ == "__main__":
    main()
