"""The simulated machines that judge the diagnosis: a reality of its own, the same for the same seed, and sealed."""

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from frictionjax.recordings import load_case

ROOT = Path(__file__).parents[2]
CONCEALED = ROOT / "benchmarks" / "concealed" / "reality"


def imported(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_simulator_and_library_know_nothing_of_each_other():
    files = sorted(CONCEALED.glob("*.py"))
    assert len(files) > 5
    for path in files:
        roots = {name.split(".")[0] for name in imported(path)}
        assert not roots & {"frictionjax", "jax", "equinox", "diffrax", "optimistix"}, path
    for path in (ROOT / "frictionjax").rglob("*.py"):
        assert not any(name.startswith("benchmarks") for name in imported(path)), path


def test_a_seed_is_a_machine_whatever_is_missing(tmp_path):
    pytest.importorskip("numba")
    from benchmarks.concealed.reality import make_case, write_case

    plain, again, other = (
        make_case(3, missing=missing, families="few", substeps=4)
        for missing in ((), (), ("direction_asymmetry",))
    )
    assert plain.plant == again.plant == other.plant
    assert [r["name"] for r in plain.recordings] == [r["name"] for r in other.recordings]
    for one, same, changed in zip(plain.recordings, again.recordings, other.recordings, strict=True):
        np.testing.assert_array_equal(one["x"], same["x"])
        assert np.all(np.isfinite(changed["x"])) and one["x"].size == changed["x"].size
    assert any(
        not np.array_equal(a["x"], b["x"]) for a, b in zip(plain.recordings, other.recordings, strict=True)
    )
    write_case(other, tmp_path / "case")
    written = "".join(p.read_text()[:2000] for p in sorted((tmp_path / "case").iterdir()))
    assert "asymmetry" not in written and "missing" not in written
    read = load_case(tmp_path / "case" / "case.toml")
    assert [r.role for r in read.recordings] == [r["role"] for r in other.recordings]


@pytest.mark.slow
def test_the_bank_names_an_effect_and_leaves_a_null_alone(tmp_path):
    pytest.importorskip("numba")
    command = [sys.executable, "-m", "benchmarks.diagnosis", "--seeds", "1", "--nulls", "1", "--effects"]
    command += ["direction_asymmetry", "--plans", "one", "none", "--out", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "| direction_asymmetry | strong | 1 |" in done.stdout
    assert "strong: right within class 1 of 1, named wrongly 0" in done.stdout
    assert "nothing missing, 1: adequate 1" in done.stdout
