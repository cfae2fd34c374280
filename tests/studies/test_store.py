"""The store of a study: what it holds, how it survives interrupts, full disks and damage, and whom it refuses."""

import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import pytest
from helpers_studies import compiled_study, noted_study, plain_study, same

from frictionjax import InputError, PythonTask, load_study, run_study
from frictionjax.core import FrictionjaxWarning
from frictionjax.studies import StudyStopped, shards

pytest.importorskip("zarr")
pytestmark = pytest.mark.filterwarnings("ignore:.*cases failed; the first")

QUIET = {"progress": False}


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


def test_an_interrupt_lets_devices_finish_their_blocks(tmp_path):
    study, store = compiled_study(), tmp_path / "s.zarr"

    def report(stage, fraction):
        if fraction > 0.1:
            raise KeyboardInterrupt

    with pytest.raises(StudyStopped, match="of 480 cases are finished"):
        run_study(study, store, chunk=16, progress=report)
    # On a busy machine all blocks may be finished before the first is reported.
    assert sum(len(p) for p in shards.finished_places(tmp_path / "s.zarr.parts")) > 0
    same(run_study(study, **QUIET), run_study(study, store, **QUIET))


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
