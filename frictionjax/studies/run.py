"""`run_study`: compute the cases of a study, wherever and with however many interruptions."""

import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import numpy as np

from frictionjax.core import FrictionjaxWarning, InputError, Progress, reporting
from frictionjax.core.frames import require_studies
from frictionjax.core.setup import jax_settings
from frictionjax.studies.dataset import dataset_of
from frictionjax.studies.dispatch import (
    Chunks,
    Devices,
    Lost,
    Numbers,
    Submits,
    WorkersLost,
    in_turn,
    on_executor,
    refuse_fork,
    workers_of,
)
from frictionjax.studies.pace import Pace
from frictionjax.studies.shards import Shard
from frictionjax.studies.store import Store
from frictionjax.studies.study import Blocks, Study, versions
from frictionjax.studies.worker import Done, Order, compute, packed, work


class StudyStopped(KeyboardInterrupt):
    """A study was interrupted; its text says what is finished and how to go on."""


def run_study(
    study: Study,
    store: str | Path | None = None,
    executor: Submits | None = None,
    *,
    progress: Progress | bool = True,
    chunk: int | None = None,
    devices: Sequence[Any] | None = None,
) -> Any:
    """Compute every case of a study.

    With a `store`, what is finished survives whatever stops the run, and the same call goes on from there: nothing is
    computed twice. Results are the same bit by bit on one kind of hardware, however the cases are distributed.

    **Arguments:**

    - `study`: the `Study`.
    - `store`: folder that becomes a Zarr store (format 3); None: results are in memory only, and an interrupted run
        loses them. Workers on other machines need the same path.
    - `executor`: whose workers compute: anything with the `submit` of `concurrent.futures`, such as a pool of processes
        with the "spawn" context, or `dask.distributed.Client.get_executor()`. None: this process, on `devices`.
    - `progress`: called as cases are finished, with their rate and the time left; True: a bar on a terminal and in a
        notebook; False: nothing.
    - `chunk`: cases that a worker is given at a time, which are one file; by default as many as take about five
        seconds, at most 5,000, and no more than 256 MB of results. A queue in which jobs wait wants longer ones.
    - `devices`: of JAX, for a task that is compiled; None: all of this process.

    **Returns:**

    An xarray `Dataset`: results over the dimensions of the design, with units and coordinates; `failed` and `reason`
    say which cases failed and why; the attribute `study` holds design, task, seed and versions.

    **Raises:** `InputError` where the store belongs to another study or another run is writing it, where it cannot be
        written, or the executor copies this process by `fork`; `StudyStopped`, a `KeyboardInterrupt`, when interrupted;
        `WorkersLost`, a `RuntimeError`, where workers were lost; `ImportError` where xarray or zarr is missing.
    """
    if not isinstance(study, Study):
        raise InputError(
            f"a {type(study).__name__} is no study", place="`study`", cure="Give Study(design, task)"
        )
    if executor is not None:
        refuse_fork(executor)
    if chunk is not None and chunk < 1:
        raise InputError(f"`chunk` is {chunk}", cure="Give a worker one case at a time or more")
    run = _Run(study, executor, chunk, devices)
    with reporting(progress) as report:
        if store is None:
            require_studies("run_study")
            shards: list[Shard] = []
            run.all(np.zeros(study.design.size, bool), None, report, shards)
            found = dataset_of(study, shards, study.described() | {"versions": versions()})
        else:
            place = Store(study, Path(store))
            with place.claimed():
                if not place.is_complete:
                    run.all(place.done(), place, report, [])
                    report("writing the store", 1.0)
                    place.complete()
                place.tidy()
                found = place.load()
    _warn_of_failures(found)
    return found


class _Run:
    """How a `study` is computed: by an `executor`, in chunks of `chunk` cases, or on `devices`."""

    def __init__(
        self, study: Study, executor: Submits | None, chunk: int | None, devices: Sequence[Any] | None
    ) -> None:
        self.study, self.executor, self.chunk, self.devices = study, executor, chunk, devices
        self.blocks = Blocks(study)

    def all(self, done: Any, place: Store | None, report: Progress, shards: list[Shard]) -> None:
        """Compute the cases that are not `done`, shape `(n,)`, into the store at `place`, or, without one, into
        `shards`."""
        left = self.blocks.unfinished(done)
        pace = Pace(report, self.study.design.size, int(done.sum()))
        pace.start("compiling" if self.study.task.on_devices else "starting")
        try:
            for one in self._outcomes(left, place, pace):
                if isinstance(one, Lost):
                    _warn_of_loss(one)
                elif one.shard is not None:
                    shards.append(one.shard)
        except KeyboardInterrupt as interrupt:
            raise StudyStopped(_how_to_go_on("The study was stopped", place)) from interrupt
        except BrokenExecutor as error:
            text = _how_to_go_on(f"A worker was lost, and the executor has ended ({error})", place)
            raise WorkersLost(text) from error
        except WorkersLost as error:
            text = _how_to_go_on(f"Workers were lost twice at the same cases ({error})", place)
            raise WorkersLost(text) from error
        if place is not None and not (finished := place.done()).all():
            raise WorkersLost(
                f"{int((~finished).sum())} cases were computed and are not in {place.parts}: let all workers see that "
                "folder under the same path."
            )

    def _outcomes(self, left: Numbers, place: Store | None, pace: Pace) -> Iterator[Done | Lost]:
        folder, settings, task = None if place is None else place.parts, jax_settings(), self.study.task

        def order(numbers: Numbers, what: Any) -> Order:
            return Order(what, self.study.seed, self.blocks.take(numbers), folder, settings)

        def chunks(workers: int | None) -> Chunks:
            return Chunks(left, task.lanes, self.chunk, workers or 1)

        if self.executor is not None:
            workers = workers_of(self.executor)
            what = task if isinstance(self.executor, ThreadPoolExecutor) else packed(task)
            submit = self.executor.submit
            found = on_executor(chunks(workers), lambda n: submit(work, order(n, what)), workers, pace.show)
            for one in found:
                if isinstance(one, Done):
                    pace.add(one.count, one.failed)
                yield one
            return
        devices = self._devices()
        if len(devices) < 2:

            def here(numbers: Numbers) -> Done:
                device = devices[0] if devices else None
                done = compute(task, order(numbers, task), device=device, report=pace.add)
                pace.failed(done.failed)
                return done

            yield from in_turn(chunks(1), here)
            return

        def there(numbers: Numbers, device: Any) -> Done:
            stopped = crew.stopping.is_set
            done = compute(task, order(numbers, task), device=device, stopped=stopped, report=pace.count)
            pace.failed(done.failed)
            return done

        crew = Devices(devices, there)
        try:
            yield from on_executor(chunks(len(devices)), crew.submit, len(devices), pace.show)
        finally:
            crew.close()

    def _devices(self) -> Sequence[Any]:
        if not self.study.task.on_devices:
            return ()
        return jax.local_devices() if self.devices is None else self.devices


def _how_to_go_on(what: str, place: Store | None) -> str:
    if place is None:
        return f"{what}. Without a `store` nothing of it is kept."
    done = place.done()
    return (
        f"{what}: {int(done.sum()):,} of {done.size:,} cases are finished. Run it again with the store "
        f"{place.target} (`frictionjax study` with --resume): it goes on from there."
    )


def _warn_of_loss(one: Lost) -> None:
    text = " ".join(str(one.error).split())
    warnings.warn(
        f"A worker was lost; its cases are computed again ({text[:200]}).", FrictionjaxWarning, stacklevel=4
    )


def _warn_of_failures(found: Any) -> None:
    failed = found["failed"].values
    if failed.any():
        first = str(found["reason"].values[failed][0])
        warnings.warn(
            f"{int(failed.sum()):,} of {failed.size:,} cases failed; the first: {first}. `reason` has them all.",
            FrictionjaxWarning,
            stacklevel=3,
        )
