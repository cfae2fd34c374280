"""Seconds to read a large CSV: `python -m benchmarks.reading`.

A log of 100 MB (`--megabytes`) is written into a temporary folder and read by our reader with polars and without, and
by pandas.read_csv, each time in a process of its own, in turns. The libraries are loaded before the clock starts; it
stops when t, u and x are arrays. pandas rounds by its own fast rule, the other two to the nearest number.
"""

import argparse
import importlib.util
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.timing import machine

_READ = """
import json, sys, time
from pathlib import Path
{prepare}
start = time.perf_counter()
{read}
seconds = time.perf_counter() - start
print(json.dumps([seconds, [float(values.sum()) for values in found], int(found[0].size)]))
"""
_OURS = "from frictionjax.recordings.readers import open_table"
_OUR_READ = "found = open_table(Path(sys.argv[1])).read(['t', 'u', 'x'])"
WAYS = {
    "our reader, polars installed": ("polars", f"import polars\n{_OURS}", _OUR_READ),
    "our reader, without polars": ("numpy", f"sys.modules['polars'] = None\n{_OURS}", _OUR_READ),
    "pandas.read_csv": (
        "pandas",
        "import pandas",
        "frame = pandas.read_csv(sys.argv[1]); found = [frame[name].to_numpy() for name in ('t', 'u', 'x')]",
    ),
}
"""How it is read -> the library that this needs, what is loaded before, what is timed."""
_ROWS = 20_000
"""Rows that are written at a time."""


def write(path: Path, size: int) -> int:
    """Write a log of t, u, x and a temperature, with nine digits, of at least `size` bytes; the number of rows."""
    random, rows = np.random.default_rng(7), 0
    with path.open("w", encoding="utf-8") as stream:
        stream.write("t,u,x,temperature\n")
        while stream.tell() < size:
            t = (rows + np.arange(_ROWS)) / 2000.0
            u, x = random.normal(size=_ROWS), 0.01 * np.sin(3.0 * t) + 1e-6 * random.normal(size=_ROWS)
            np.savetxt(stream, np.column_stack([t, u, x, 20.0 + 1e-3 * t]), delimiter=",", fmt="%.9g")
            rows += _ROWS
    return rows


def seconds_of(way: str, path: Path) -> tuple[float, list[float], int]:
    """Seconds of one reading in a process of its own; the sums of the columns, and their length."""
    _, prepare, read = WAYS[way]
    code = _READ.format(prepare=prepare, read=read)
    done = subprocess.run([sys.executable, "-c", code, str(path)], check=True, capture_output=True, text=True)
    seconds, sums, rows = json.loads(done.stdout)
    return seconds, sums, rows


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megabytes", type=float, default=100.0)
    parser.add_argument("--repeats", type=int, default=5)
    arguments = parser.parse_args()
    print(json.dumps(machine()))
    ways = [way for way, (needed, *_) in WAYS.items() if importlib.util.find_spec(needed)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        rows = write(path, round(1e6 * arguments.megabytes))
        size = path.stat().st_size / 1e6
        found = {way: [] for way in ways}
        for _ in range(arguments.repeats):
            for way in ways:
                found[way].append(seconds_of(way, path))
    reference = found[ways[-1]][0][1]
    print(f"| {size:.4g} MB, {rows:,} rows, 4 columns | seconds |\n|---|---|")
    for way, runs in found.items():
        for _, sums, read in runs:
            if read != rows or not np.allclose(sums, reference, rtol=1e-9, atol=1e-6):
                raise SystemExit(f"{way} read other numbers")
        print(f"| {way} | {median(seconds for seconds, *_ in runs):.3g} |")
    for way in WAYS.keys() - found.keys():
        print(f"| {way} | not installed |")


if __name__ == "__main__":
    main()
