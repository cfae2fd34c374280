"""The benchmark of reading runs on a small file, and every way reads the same numbers."""

import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(
    not (REPOSITORY / "benchmarks").is_dir(), reason="an installed package has no benchmarks"
)


def test_every_way_of_reading_has_a_row():
    command = [sys.executable, "-m", "benchmarks.reading", "--megabytes", "2", "--repeats", "1"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    rows = dict(line.strip("| ").split(" | ") for line in done.stdout.splitlines() if line.startswith("| "))
    assert rows.pop(next(iter(rows))) == "seconds"
    assert set(rows) == {"our reader, polars installed", "our reader, without polars", "pandas.read_csv"}
    assert float(rows["our reader, without polars"]) > 0.0
    assert all(value == "not installed" or float(value) > 0.0 for value in rows.values())
