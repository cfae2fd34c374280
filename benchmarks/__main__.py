"""`python -m benchmarks`: run benchmarks, keep the numbers, and rewrite the tables in docs/benchmarks/ from all kept.

    python -m benchmarks [NAME ...] [--small] [--keep FOLDER]

NAME: one or more of `accuracy`, `simulation`, `solvers`, `parallel_in_time`, `lanes`, `flags`, `simulation_gpu`,
`compile_time`, `compile_time_diagnose`, `estimation_study`, `estimation_refit`, `estimation_plants`, `studies`;
all if none is given.
"""

import argparse
import datetime
import importlib
import json
import math
import platform
import re
import sys
import time
from pathlib import Path

import frictionjax

NAMES = (
    "accuracy",
    "simulation",
    "solvers",
    "parallel_in_time",
    "lanes",
    "flags",
    "simulation_gpu",
    "compile_time",
    "compile_time_diagnose",
    "estimation_study",
    "estimation_refit",
    "estimation_plants",
    "studies",
)
HERE = Path(__file__).parent
RESULTS = HERE / "results"
PAGES = HERE.parent / "docs" / "benchmarks"
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end of table -->)", re.S)


def line(entry: dict) -> str:
    """One row of the table as Markdown."""
    value = "-" if math.isnan(entry["value"]) else f"{entry['value']:.3g}"
    met = {None: "", True: "yes", False: "**no**"}[entry["met"]]
    return f"| {entry['what']} | {value} | {entry['unit']} | {entry['goal']} | {met} |"


def table(results: list[dict]) -> str:
    """The table of several benchmarks as Markdown."""
    lines = []
    for result in results:
        about = result["machine"]
        lines += [
            f"### {result['name']}",
            "",
            f"{about['processor']}, {about['cores']} cores, {about['memory_GiB']} GiB; JAX {about['jax']}, Python "
            f"{about['python']}; {result['date']}, {result['seconds']:.0f} s; load before it {about['load_before']}.",
            "",
            "| what | measured | unit | goal | met |",
            "|---|---|---|---|---|",
            *(line(entry) for entry in result["rows"]),
            "",
        ]
        lines += [f"{note}\n" for note in result["notes"]]
    return "\n".join(lines)


def rewrite(pages: Path = PAGES) -> None:
    """Put the table of each benchmark whose results are kept where a page of the folder `pages` has its place."""
    placed = set()

    def filled(place: re.Match[str]) -> str:
        placed.add(place[2])
        results = [json.loads(file.read_text()) for file in sorted(RESULTS.glob(f"{place[2]}--*.json"))]
        return f"{place[1]}\n{table(results)}\n{place[3]}" if results else place[0]

    for page in sorted(pages.glob("*.md")):
        page.write_text(PLACE.sub(filled, page.read_text(encoding="utf-8")), encoding="utf-8")
    if missing := [name for name in NAMES if name not in placed]:
        raise LookupError(f"no page in {pages} has a place for {', '.join(missing)}")


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[*NAMES, []], metavar="NAME", help=", ".join(NAMES))
    parser.add_argument(
        "--small", action="store_true", help="small sizes, to see that it runs; keeps nothing"
    )
    parser.add_argument("--keep", type=Path, default=RESULTS, metavar="FOLDER", help="for the JSON")
    arguments = parser.parse_args()
    frictionjax.configure_jax()
    from benchmarks.timing import machine

    about = machine()
    for name in arguments.names or NAMES:
        sys.stderr.write(f"{name} ...\n")
        start = time.perf_counter()
        module = importlib.import_module(f"benchmarks.{name}")
        rows = module.measure(small=arguments.small)
        result = {
            "name": name,
            "date": datetime.date.today().isoformat(),
            "machine": about | {"name": platform.node()},
            "seconds": time.perf_counter() - start,
            "rows": [entry for entry in rows if "note" not in entry],
            "notes": [entry["note"] for entry in rows if "note" in entry],
        }
        sys.stdout.write(table([result]) + "\n")
        sys.stdout.flush()
        if not arguments.small:
            arguments.keep.mkdir(parents=True, exist_ok=True)
            processor = re.sub("[^a-z0-9]+", "-", about["processor"].lower()).strip("-")
            file = arguments.keep / f"{name}--{processor}.json"
            file.write_text(json.dumps(result, indent=1) + "\n")
    if not arguments.small and arguments.keep == RESULTS:
        rewrite()
    return 0


if __name__ == "__main__":
    sys.exit(main())
