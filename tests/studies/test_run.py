"""`run_study`: the same numbers however cases are distributed, resumed from disk, failures kept with their reason."""

import json
import os
import shutil
import threading
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_studies import compiled_study, drawn, noted_study, plain, plain_study, same

from frictionjax import (
    Axis,
    CompiledTask,
    Factorial,
    InputError,
    PythonTask,
    RandomDesign,
    Study,
    load_study,
    run_study,
)
from frictionjax.core import FrictionjaxWarning
from frictionjax.studies import StudyStopped, dispatch, shards

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


def test_the_store_holds_the_design_the_versions_and_the_seed(tmp_path):
    run_study(plain_study(repeats=2, seed=3), tmp_path / "s.zarr", **QUIET)
    about = load_study(tmp_path / "s.zarr").attrs["study"]
    assert about["seed"] == 3 and about["format"] == 1
    assert about["design"]["repeats"] == 2 and about["design"]["axes"][0]["values"] == [1.0, 2.0]
    assert about["task"]["function"] == "helpers_studies.plain"
    assert about["versions"]["jax"] == jax.__version__ and {"frictionjax", "numpy"} <= set(about["versions"])
    assert json.loads((tmp_path / "s.zarr" / "zarr.json").read_text())["zarr_format"] == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.zarr"]


def _notes(monkeypatch, folder):
    path = Path(folder) / "notes"
    path.touch()
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", str(path))
    return lambda: path.read_text().split()


class _Halt(Exception):
    pass


def _halting(after):
    """A progress that stops a study after so many cases, as an error in the caller's own code would."""

    def report(stage, fraction):
        if fraction >= after:
            raise _Halt

    return report


def test_a_finished_study_computes_nothing_again(tmp_path, monkeypatch):
    notes = _notes(monkeypatch, tmp_path)
    first = run_study(noted_study(20), tmp_path / "s.zarr", **QUIET)
    assert len(notes()) == 20
    same(first, run_study(noted_study(20), tmp_path / "s.zarr", **QUIET))
    assert len(notes()) == 20


def test_an_interrupt_stops_cleanly_and_says_how_to_go_on(tmp_path, monkeypatch):
    notes = _notes(monkeypatch, tmp_path)
    store = tmp_path / "s.zarr"
    compute, stop = PythonTask.compute, [13]

    def interrupted(self, seed, block):
        if len(notes()) == stop[0]:
            raise KeyboardInterrupt
        return compute(self, seed, block)

    monkeypatch.setattr(PythonTask, "compute", interrupted)
    with pytest.raises(
        StudyStopped, match=r"stopped: 13 of 20 cases are finished\. Run it again with .*s\.zarr"
    ):
        run_study(noted_study(20), store, chunk=5, **QUIET)
    assert not store.exists()
    with pytest.raises(InputError, match="the study is not finished"):
        load_study(store)
    stop[0] = -1
    found = run_study(noted_study(20), store, chunk=7, **QUIET)
    assert sorted(notes(), key=int) == [str(k) for k in range(20)]
    same(found, run_study(noted_study(20), **QUIET))
    stop[0] = 40 + 13
    with pytest.raises(StudyStopped, match="Without a `store` nothing of it is kept"):
        run_study(noted_study(20), **QUIET)


def test_an_interrupt_lets_devices_finish_their_blocks(tmp_path, alone):
    study, store = compiled_study(), tmp_path / "s.zarr"

    def report(stage, fraction):
        if fraction > 0.1:
            raise KeyboardInterrupt

    with pytest.raises(StudyStopped, match="of 480 cases are finished"):
        run_study(study, store, chunk=16, progress=report)
    assert 0 < sum(len(p) for p in shards.finished_places(tmp_path / "s.zarr.parts")) < 480
    same(alone, run_study(study, store, **QUIET))


def test_a_full_disk_is_a_sentence_and_finished_shards_stay(tmp_path, monkeypatch):
    notes = _notes(monkeypatch, tmp_path)
    store, fsync, count = tmp_path / "s.zarr", os.fsync, [0]

    def full(place):
        count[0] += 1
        if count[0] > 8:
            raise OSError(28, "No space left on device")
        fsync(place)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        InputError,
        match=r"cannot be written \(No space left on device\); those that are finished stay",
    ):
        run_study(noted_study(20), store, chunk=2, **QUIET)
    kept = sum(len(p) for p in shards.finished_places(tmp_path / "s.zarr.parts"))
    assert kept and not list((tmp_path / "s.zarr.parts").glob(".*.part"))
    monkeypatch.setattr(os, "fsync", fsync)
    before = len(notes())
    run_study(noted_study(20), store, **QUIET)
    assert len(notes()) - before == 20 - kept


def test_a_full_disk_at_the_very_end_costs_nothing(tmp_path, monkeypatch):
    notes = _notes(monkeypatch, tmp_path)
    store, rename = tmp_path / "s.zarr", Path.rename

    def full(self, target):
        if self.name == "new.zarr":
            raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", full)
    with pytest.raises(InputError, match="No space left on device"):
        run_study(noted_study(20), store, **QUIET)
    monkeypatch.undo()
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", os.devnull)
    run_study(noted_study(20), store, **QUIET)
    assert len(notes()) == 20


def test_two_runs_on_one_store_refuse_each_other(tmp_path):
    store, inside, leave = tmp_path / "s.zarr", threading.Event(), threading.Event()

    def report(stage, fraction):
        inside.set()
        leave.wait(60)

    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(run_study, plain_study(), store, progress=report)
        assert inside.wait(60)
        try:
            with pytest.raises(InputError, match=r"s\.zarr: another run is writing into this store"):
                run_study(plain_study(), store, **QUIET)
        finally:
            leave.set()
        same(first.result(60), run_study(plain_study(), store, **QUIET))


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (plain_study(seed=1), "seed is 0 there and 1 here"),
        (plain_study(repeats=11), "design.repeats is 10 there and 11 here"),
        (
            plain_study(gains=(1.0, 3.0)),
            r"design.axes gain.values is \[1.0, 2.0\] there and \[1.0, 3.0\] here",
        ),
        (plain_study(function=lambda rng, gain: {}), "task.function is .*plain.* there and .*lambda.* here"),
    ],
)
@pytest.mark.parametrize("finished", [True, False])
def test_the_store_of_another_study_is_refused(tmp_path, other, words, finished):
    store = tmp_path / "s.zarr"
    if finished:
        run_study(plain_study(), store, **QUIET)
    else:
        with pytest.raises(_Halt):
            run_study(plain_study(), store, progress=_halting(0.0))
    with pytest.raises(InputError, match=f"the results there are of another study: .*{words}"):
        run_study(other, store, **QUIET)


def test_what_is_no_store_is_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    for path, words in (
        (tmp_path / "mine", "exists and is not the store of a study"),
        (tmp_path / "no", "there is no such store"),
    ):
        with pytest.raises(InputError, match=words):
            load_study(path)
    with pytest.raises(InputError, match="exists and is not the store of a study"):
        run_study(plain_study(), tmp_path / "mine", **QUIET)


def test_a_damaged_shard_is_computed_again(tmp_path, monkeypatch):
    notes = _notes(monkeypatch, tmp_path)
    store = tmp_path / "s.zarr"
    with pytest.raises(_Halt):
        run_study(noted_study(20), store, chunk=5, progress=lambda stage, part: _halting(1.0)(stage, part))
    file = shards.shard_files(tmp_path / "s.zarr.parts")[1]
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 255
    file.write_bytes(content)
    with pytest.warns(
        FrictionjaxWarning, match=r"is damaged .* and was removed; its cases are computed again"
    ):
        found = run_study(noted_study(20), store, **QUIET)
    assert len(notes()) == 25 and not found["failed"].any()


def test_other_versions_are_a_warning(tmp_path):
    store = tmp_path / "s.zarr"
    with pytest.raises(_Halt):
        run_study(plain_study(), store, progress=_halting(0.0))
    about = tmp_path / "s.zarr.parts" / "study.json"
    about.write_text(about.read_text().replace(jax.__version__, "0.0.1"))
    with pytest.warns(FrictionjaxWarning, match=r"computed with jax is \"0\.0\.1\" there"):
        run_study(plain_study(), store, **QUIET)


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
