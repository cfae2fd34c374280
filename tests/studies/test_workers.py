"""Studies on other processes: killed at any moment, workers lost, two schedulers; nothing is lost or computed twice."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from pathlib import Path

import jax
import pytest
from helpers_studies import compiled_study, noted_study, plain_study, same

import frictionjax
from frictionjax import Axis, Factorial, InputError, PythonTask, Study, run_study
from frictionjax.core import FrictionjaxWarning
from frictionjax.studies import worker

pytest.importorskip("zarr")
pytestmark = pytest.mark.filterwarnings("ignore:.*cases failed; the first")

QUIET = {"progress": False}
SUPPORT = Path(__file__).parents[1] / "support"


def spawned(workers):
    return ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied by fork")
@pytest.mark.parametrize(("moments", "seed"), [(3, 1), pytest.param(20, 2, marks=pytest.mark.slow)])
def test_a_study_that_is_killed_goes_on_where_it_stopped(tmp_path, moments, seed):
    path = os.pathsep.join([str(SUPPORT), str(Path(frictionjax.__file__).parents[1])])
    command = [sys.executable, str(SUPPORT / "helpers_kill_study.py"), str(tmp_path), str(moments), str(seed)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=600, env=os.environ | {"PYTHONPATH": path}
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["runs"]) >= moments
    for run in found["runs"]:
        assert run["status"] == 0 and run["lost"] == 0 and run["again"] == 0
        # What a kill costs: at most the chunk that was being computed.
        assert 60 <= run["computed"] <= 60 + 3 * run["kills"]
    assert sum(run["kills"] for run in found["runs"]) >= moments
    assert found["left"] == sorted(["notes", "whole.zarr", *(f"{k}.zarr" for k in range(len(found["runs"])))])


def test_a_pool_of_processes_gives_the_same_numbers(tmp_path):
    with spawned(1) as pool:
        found = run_study(compiled_study(repeats=6), tmp_path / "s.zarr", pool, **QUIET)
    # Another file of tests may have compiled the same study in this process, with fewer optimisations.
    jax.clear_caches()
    same(found, run_study(compiled_study(repeats=6), devices=jax.local_devices()[:1], **QUIET))


def dying(rng, number):
    """The process of case 5 is killed, the first time."""
    notes = Path(os.environ["FRICTIONJAX_TEST_NOTES"])
    if number == 5 and not notes.exists():
        notes.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"value": rng.normal()}


@pytest.mark.slow
def test_a_lost_process_costs_unfinished_chunks_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", str(tmp_path / "notes"))
    study = Study(Factorial(Axis("number", range(12))), PythonTask(dying))
    with (
        spawned(1) as pool,
        pytest.raises(RuntimeError, match=r"A worker was lost.* 4 of 12 cases are finished\. Run"),
    ):
        run_study(study, tmp_path / "s.zarr", pool, chunk=2, **QUIET)
    with spawned(1) as pool:
        found = run_study(study, tmp_path / "s.zarr", pool, **QUIET)
    same(found, run_study(study, **QUIET))


@pytest.mark.slow
def test_dask_goes_on_when_one_of_its_workers_is_killed(tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", str(tmp_path / "notes"))
    monkeypatch.setenv("FRICTIONJAX_TEST_PAUSE", "0.05")
    killed = []
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        numbers = client.run(os.getpid)

        def kill(stage, fraction):
            if fraction > 0.2 and not killed:
                killed.append(next(iter(numbers.values())))
                os.kill(killed[0], signal.SIGKILL)

        study = noted_study(60)
        found = run_study(study, tmp_path / "s.zarr", client.get_executor(), chunk=3, progress=kill)
        assert killed and client.run(os.getpid) != numbers
    computed = (tmp_path / "notes").read_text().split()
    assert {*computed} == {str(k) for k in range(60)}
    assert len(computed) <= 60 + 3  # the chunk that was lost, and no other
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", os.devnull)
    monkeypatch.setenv("FRICTIONJAX_TEST_PAUSE", "0")
    same(found, run_study(study, **QUIET))


class KilledWorker(Exception):
    """As Dask says it."""


KilledWorker.__module__ = "distributed.scheduler"


class Losing:
    """An executor that carries out what it is given at once, and loses the workers of some of it; `kind`: the error."""

    def __init__(self, kind, losses):
        self.kind, self.losses, self.given = kind, losses, 0

    def submit(self, function, argument):
        future = Future()
        self.given += 1
        if self.given in self.losses:
            future.set_exception(self.kind("a worker was killed"))
        else:
            future.set_result(function(argument))
        return future


class Job:
    """A future of another kind, as submitit has it."""

    def __init__(self, future):
        self._future, self._asked = future, 0
        self.cancel, self.result, self.exception = future.cancel, future.result, future.exception

    def done(self):
        self._asked += 1
        return self._asked > 1


class Jobs(Losing):
    def submit(self, function, argument):
        return Job(super().submit(function, argument))


def test_a_chunk_whose_worker_was_lost_is_computed_again(tmp_path):
    study = plain_study(repeats=10)
    executor = Losing(KilledWorker, {2, 4})
    with pytest.warns(
        FrictionjaxWarning, match=r"A worker was lost; its cases are computed again \(a worker"
    ):
        found = run_study(study, tmp_path / "s.zarr", executor, chunk=4, **QUIET)
    assert executor.given == 5 + 2
    same(found, run_study(study, **QUIET))


def test_a_chunk_that_loses_its_workers_twice_ends_the_study(tmp_path):
    with (
        pytest.warns(FrictionjaxWarning, match="A worker was lost"),
        pytest.raises(
            RuntimeError, match=r"Workers were lost twice .*: 16 of 20 cases are finished\. Run it again"
        ),
    ):
        run_study(
            plain_study(repeats=10), tmp_path / "s.zarr", Losing(KilledWorker, {2, 6}), chunk=4, **QUIET
        )


def test_an_executor_that_has_ended_is_a_sentence(tmp_path):
    study, store = plain_study(repeats=10), tmp_path / "s.zarr"
    with pytest.raises(
        RuntimeError, match=r"A worker was lost, and the executor has ended .*it goes on from there"
    ):
        run_study(study, store, Losing(BrokenExecutor, {3, 4, 5}), chunk=4, **QUIET)
    same(run_study(study, store, Losing(BrokenExecutor, {}), **QUIET), run_study(study, **QUIET))


def test_futures_of_another_kind_are_asked_whether_they_are_done(tmp_path, monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    study = plain_study(repeats=5)
    same(run_study(study, executor=Jobs(KilledWorker, {}), chunk=4, **QUIET), run_study(study, **QUIET))


def test_workers_that_write_elsewhere_are_noticed(tmp_path, monkeypatch):
    (tmp_path / "other").mkdir()

    class Elsewhere(Losing):
        def submit(self, function, argument):
            return super().submit(function, argument._replace(folder=tmp_path / "other"))

    with pytest.raises(
        RuntimeError, match=r"20 cases were computed and are not in .*let all workers see that folder"
    ):
        run_study(plain_study(), tmp_path / "s.zarr", Elsewhere(KilledWorker, {}), **QUIET)


def test_what_a_lost_worker_has_written_is_not_computed_again(tmp_path, monkeypatch):
    notes = tmp_path / "notes"
    monkeypatch.setenv("FRICTIONJAX_TEST_NOTES", str(notes))

    class Silent(Losing):
        """The worker writes its shard, and is lost before it says so."""

        def submit(self, function, argument):
            if self.given == 1:
                function(argument)
            return super().submit(function, argument)

    with pytest.warns(FrictionjaxWarning, match="A worker was lost"):
        run_study(noted_study(20), tmp_path / "s.zarr", Silent(KilledWorker, {2}), chunk=4, **QUIET)
    assert len(notes.read_text().split()) == 20


def test_a_function_without_a_name_is_sent_by_value_or_refused(monkeypatch):
    task = PythonTask(lambda rng, number: {"value": number})
    pytest.importorskip("cloudpickle")
    again = worker._task(worker.packed(task))
    assert again.function(None, 3) == {"value": 3} and worker._task(worker.packed(task)) is not task
    monkeypatch.setattr(worker.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"cannot be sent to another process .*top of a module, or install cloudpickle"
    ):
        worker.packed(task)
    assert worker._task(worker.packed(plain_study().task)).function is plain_study().task.function
