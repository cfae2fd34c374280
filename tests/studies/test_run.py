"""`run_study`: the same numbers however cases are distributed, resumed from disk, failures kept with their reason."""

import shutil
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_studies import compiled_study, drawn, plain, plain_study, same

from frictionjax import (
    Axis,
    CompiledTask,
    Factorial,
    InputError,
    PythonTask,
    RandomDesign,
    Study,
    run_study,
)
from frictionjax.core import FrictionjaxWarning
from frictionjax.studies import dispatch

pytest.importorskip("zarr")
pytestmark = pytest.mark.filterwarnings("ignore:.*cases failed; the first")

QUIET = {"progress": False}


@pytest.fixture(scope="module")
def alone():
    """The result of a compiled study on one device, in memory."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FrictionjaxWarning)
        return run_study(compiled_study(), devices=jax.local_devices()[:1], **QUIET)


def test_the_result_has_dimensions_units_and_coordinates(alone):
    assert dict(alone.sizes) == {"gain": 3, "kind": 2, "offset": 2, "repeat": 40, "step": 3}
    assert alone["value"].dims == ("gain", "kind", "offset", "repeat")
    assert alone["history"].dims[-1] == "step"
    assert alone["value"].attrs["units"] == "N" and alone["offset"].attrs["units"] == "m"
    assert list(alone["kind"].values) == ["plain", "squared"]
    one = alone.sel(gain=2.0, kind="plain", offset=10.0, repeat=17)
    other = alone.sel(gain=2.0, kind="squared", offset=10.0, repeat=17)
    place = np.ravel_multi_index((1, 0, 1, 17), (3, 2, 2, 40))
    key = jax.random.fold_in(jax.random.key(5), int(place))
    np.testing.assert_allclose(one["value"], drawn(key, 2.0, 10.0)["value"], rtol=1e-14)
    assert not np.array_equal(one["history"], other["history"])


@pytest.mark.parametrize("how", ["chunk 8", "chunk 32", "devices", "backwards", "threads"])
def test_results_are_the_same_bit_by_bit_however_cases_are_distributed(alone, how, tmp_path, monkeypatch):
    study = compiled_study()
    if how.startswith("chunk"):
        found = run_study(study, tmp_path / "s.zarr", chunk=int(how.split()[1]), **QUIET)
    elif how == "devices":
        assert len(jax.local_devices()) > 1
        found = run_study(study, devices=jax.local_devices(), chunk=16, **QUIET)
    elif how == "backwards":
        take = dispatch.Chunks.take
        monkeypatch.setattr(dispatch.Chunks, "take", lambda self: take(self)[::-1])
        found = run_study(study, chunk=48, devices=jax.local_devices()[:1], **QUIET)
    else:
        with ThreadPoolExecutor(2) as pool:
            found = run_study(study, executor=pool, **QUIET)
    same(alone, found)


def test_a_jitted_case_that_fails_keeps_its_numbers_and_its_reason(alone):
    infinite = ~np.isfinite(alone["value"].values)
    late = (alone["history"].values[..., 1] <= -2.0) & ~infinite
    assert infinite.any() and late.any()
    reasons = alone["reason"].values
    assert set(reasons[infinite]) == {"`value` is not finite"}
    assert set(reasons[late]) == {"did not converge"}
    assert np.isfinite(alone["value"].values[late]).all()
    np.testing.assert_array_equal(alone["failed"].values, infinite | late)


def test_a_case_that_raises_inside_a_compiled_task_leaves_the_others(alone):
    def picky(key, gain):
        import equinox as eqx

        return {"value": eqx.error_if(gain * jax.random.normal(key), gain > 2.5, "the gain is too large")}

    study = Study(Factorial(Axis("gain", [1.0, 3.0]), repeats=3), CompiledTask(picky, lanes=4))
    found = run_study(study, **QUIET)
    assert np.isfinite(found["value"].values[0]).all() and np.isnan(found["value"].values[1]).all()
    assert all("the gain is too large" in reason for reason in found["reason"].values[1])
    assert not found["failed"].values[0].any()


def test_it_is_compiled_once():
    count = [0]

    def counted(key, gain):
        count[0] += 1
        return {"value": gain}

    task = CompiledTask(counted, lanes=4)
    one = jax.local_devices()[:1]
    run_study(Study(Factorial(Axis("gain", [1.0, 2.0]), repeats=13), task), devices=one, **QUIET)
    run_study(Study(Factorial(Axis("gain", [1.0, 5.0, 7.0]), repeats=3), task, seed=8), devices=one, **QUIET)
    assert count[0] == 1


def test_a_python_task_keeps_texts_booleans_arrays_and_failures(tmp_path):
    study = plain_study(repeats=30)
    with pytest.warns(
        FrictionjaxWarning, match="of 60 cases failed; the first: ZeroDivisionError: no result at"
    ):
        found = run_study(study, tmp_path / "s.zarr", **QUIET)
    failed = found["failed"].values
    assert failed.any() and not failed.all()
    assert np.isnan(found["value"].values[failed]).all() and np.isfinite(found["value"].values[~failed]).all()
    assert set(found["word"].values[failed]) == {""} and set(found["reason"].values[~failed]) == {""}
    assert found["positive"].dtype == bool and found["pair"].dims == ("gain", "repeat", "pair_0")
    draw = np.random.default_rng([0, 31]).normal()
    assert found["value"].values[1, 1] == 2.0 * draw
    same(found, run_study(study, **QUIET))


def test_a_random_design_has_one_dimension_and_its_axes_as_coordinates(tmp_path):
    design = RandomDesign(Axis("gain", low=1.0, high=2.0, unit="N"), cases=20)
    found = run_study(Study(design, PythonTask(plain)), tmp_path / "r.zarr", **QUIET)
    assert found["value"].dims == ("case",) and found["gain"].dims == ("case",)
    assert "gain" in found.coords and found["gain"].attrs["units"] == "N"
    assert found["value"].where(found["gain"] > 1.5, drop=True).size < 20


def test_progress_says_at_once_that_it_compiles_then_how_fast_it_is(tmp_path):
    reported = []

    def slow(key, gain):
        assert reported[0] == ("compiling", 0.0)
        return {"value": gain}

    study = Study(Factorial(Axis("gain", [1.0, 2.0]), repeats=40), CompiledTask(slow, lanes=8))
    run_study(study, devices=jax.local_devices()[:1], progress=lambda *what: reported.append(what))
    assert reported[-1][1] == 1.0 and reported[-1][0].startswith("80 of 80 cases, ")
    assert all(0.0 <= part <= 1.0 for _, part in reported)


def _with(task, *values, **how):
    study = Study(Factorial(Axis("n", values)), task)
    return lambda: run_study(study, **QUIET, **how)


@pytest.mark.untyped
@pytest.mark.parametrize(
    ("run", "words"),
    [
        (lambda: run_study(3), "a int is no study"),
        (_with(PythonTask(lambda rng, n: {}), 1, chunk=0), "`chunk` is 0"),
        (_with(PythonTask(lambda rng, n: {}), 1, executor=3), "a int has no `submit`"),
        (_with(lambda key, n: 3, 1), r"returned a int\. Return a mapping"),
        (
            _with(PythonTask(lambda rng, n: {"n": 1}), 1),
            "result `n` has the name of a coordinate.*`n_estimate`",
        ),
        (
            _with(PythonTask(lambda rng, n: {"a": [1.0] * n}), 1, 2),
            r"`a` is float64 of shape \(1,\) in one case and float64 of shape \(2,\)",
        ),
        (_with(PythonTask(lambda rng, n: {"a": [1.0]}, dims={"a": ()}), 1), "`dims` names 0 axes of `a`"),
    ],
)
def test_what_cannot_be_run_is_a_sentence(run, words):
    with pytest.raises(InputError, match=words):
        run()


def test_a_pool_that_forks_is_refused():
    import multiprocessing

    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("no fork here")
    with (
        ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool,
        pytest.raises(InputError, match=r"copied from this one by `fork`.*get_context\(\"spawn\"\)"),
    ):
        run_study(plain_study(), executor=pool, **QUIET)


def test_a_missing_library_is_named_before_the_work(monkeypatch, tmp_path):
    import sys

    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ImportError, match=r"needs zarr.*pip install 'frictionjax\[studies\]'"):
        run_study(plain_study(), tmp_path / "s.zarr", **QUIET)
    assert not shutil.os.listdir(tmp_path)
    assert jnp.ones(1).size
