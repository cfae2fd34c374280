"""The benchmarks run, in their small sizes, and what they print can be read. Nothing here looks at a time."""

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache.compilation_cache import reset_cache

from frictionjax import simulate_batch

REPOSITORY = Path(__file__).parents[2]
BENCHMARKS = REPOSITORY / "benchmarks"

pytestmark = pytest.mark.skipif(not BENCHMARKS.is_dir(), reason="an installed package has no benchmarks")


_KEEPING = {
    "jax_compilation_cache_dir": str,
    "jax_persistent_cache_min_compile_time_secs": lambda folder: 0.0,
}


@pytest.fixture
def importable(monkeypatch):
    """The benchmarks are no part of the installed package."""
    monkeypatch.syspath_prepend(str(REPOSITORY))


def _run(*arguments):
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(
        [sys.executable, "-m", "benchmarks", *arguments],
        cwd=REPOSITORY,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("accuracy", marks=pytest.mark.slow),
        pytest.param("simulation", marks=pytest.mark.slow),
        pytest.param("solvers", marks=pytest.mark.slow),
        "parallel_in_time",
        "lanes",
        "simulation_gpu",
        pytest.param("compile_time", marks=pytest.mark.slow),
        pytest.param("compile_time_diagnose", marks=pytest.mark.slow),
        pytest.param("flags", marks=pytest.mark.slow),
        pytest.param("estimation_study", marks=pytest.mark.slow),
        pytest.param("estimation_refit", marks=pytest.mark.slow),
        pytest.param("estimation_plants", marks=pytest.mark.slow),
        pytest.param("studies", marks=pytest.mark.slow),
    ],
)
def test_a_benchmark_runs_and_its_numbers_are_finite(name, tmp_path):
    before = {path: path.stat().st_mtime_ns for path in BENCHMARKS.rglob("*.json")}
    done = _run(name, "--small", "--keep", str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert f"### {name}" in done.stdout
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")][1:]
    for what, value, unit, *_ in rows:
        assert what.strip()
        assert unit.strip()
        # A rival that is not installed is a row without a number, and says so.
        assert value.strip() != "-" or "not installed" in what
        assert value.strip() == "-" or math.isfinite(float(value))
    assert rows or "nothing was measured" in done.stdout
    assert before == {path: path.stat().st_mtime_ns for path in BENCHMARKS.rglob("*.json")}


def test_what_is_timed_is_compiled_and_afterwards_programs_are_found_again(importable, tmp_path):
    from benchmarks.timing import all_compiled_anew

    def kept():
        return sorted(path.name for path in tmp_path.glob("*tripled*-cache"))

    @jax.jit
    def tripled(x):
        return 3.0 * x

    before = {name: getattr(jax.config, name) for name in _KEEPING}
    for name, value in _KEEPING.items():
        jax.config.update(name, value(tmp_path))
    reset_cache()
    try:
        with all_compiled_anew():
            tripled(1.0)
            assert not kept()
        jax.clear_caches()
        tripled(1.0)
        assert len(kept()) == 1
    finally:
        for name, value in before.items():
            jax.config.update(name, value)
        reset_cache()


def test_a_name_that_is_none_is_refused():
    done = _run("nothing")
    assert done.returncode == 2
    assert "nothing" in done.stderr


def test_results_that_are_kept_name_the_machine_and_stand_in_the_pages(importable, tmp_path):
    from benchmarks.__main__ import PAGES, rewrite

    kept = sorted((BENCHMARKS / "results").glob("*.json"))
    assert kept
    pages = {page.name: page.read_text(encoding="utf-8") for page in PAGES.glob("*.md")}
    together = "\n".join(pages.values())
    for path in kept:
        result = json.loads(path.read_text())
        assert result["machine"]["processor"]
        assert result["machine"]["cores"] >= 1
        for row in result["rows"]:
            assert row["what"] in together, f"{path.name}: no page has the row"
    for name, text in pages.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    rewrite(tmp_path)
    assert {page.name: page.read_text(encoding="utf-8") for page in tmp_path.iterdir()} == pages


def test_a_benchmark_without_a_place_in_the_pages_is_an_error(importable, tmp_path):
    from benchmarks.__main__ import rewrite

    (tmp_path / "page.md").write_text("<!-- table: lanes -->\n<!-- end of table -->\n", encoding="utf-8")
    with pytest.raises(LookupError, match="accuracy"):
        rewrite(tmp_path)
    assert "rows of one batch" in (tmp_path / "page.md").read_text(encoding="utf-8")


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_c_loop_is_the_scheme(importable):
    """Two roads to one answer: the rival in C, and ours."""
    from benchmarks.problem import DT, SAMPLE_RATE, drive_of, force, many
    from benchmarks.rivals import c_loop

    parameters, push = many(20), 3.0 * force(300)
    theirs = c_loop.runner(c_loop.build(), parameters, push, DT, substeps=2, keep_all=True)().T
    ours = simulate_batch(drive_of(parameters.T), push, SAMPLE_RATE, substeps=2)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9 * np.ptp(ours))


def test_one_gpu_kernel_is_the_scheme(importable):
    """The Pallas kernel, interpreted, against `simulate_batch`."""
    from benchmarks.problem import SAMPLE_RATE, drive_of, force, last, many
    from benchmarks.simulation_gpu import one_kernel

    parameters, push = many(128), force(40)
    kernel = one_kernel(jnp.asarray(parameters.T), jnp.asarray(push), interpret=True)
    ours = simulate_batch(drive_of(parameters.T), push, SAMPLE_RATE, substeps=1, of=last)
    np.testing.assert_allclose(kernel, ours, rtol=0, atol=1e-12 * np.max(np.abs(ours)))
