"""What computes the cases of a study, in this process or in another: blocks of cases in, one finished shard out."""

import functools
import importlib.util
import pickle
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from frictionjax.core import InputError
from frictionjax.core.setup import JaxSettings, work_as
from frictionjax.studies.shards import Shard, read_shard, shard_file, shard_of, write_shard
from frictionjax.studies.task import AbstractTask, Block, Outcome, name_of


class Order(NamedTuple):
    """What a worker is asked for.

    **Attributes:**

    - `task`: the task, or it as bytes, for another process.
    - `seed`: of the study.
    - `blocks`: the cases.
    - `folder`: where the shard is written; None: it is returned.
    - `settings`: those of JAX in the process that asks.
    """

    task: AbstractTask | bytes
    seed: int
    blocks: Sequence[Block]
    folder: Path | None
    settings: JaxSettings


class Done(NamedTuple):
    """What a worker has done.

    **Attributes:**

    - `count`: how many cases are finished.
    - `failed`: how many of them failed.
    - `seconds`: how long it took.
    - `size`: bytes of their results.
    - `shard`: they themselves; None where they were written.
    """

    count: int
    failed: int
    seconds: float
    size: int
    shard: Shard | None


def work(order: Order) -> Done:
    """Carry out an `order` in a process that works for another; what is finished when it is interrupted stays."""
    # Before anything is computed: XLA reads its flags once, and looks for compiled programs from the first one on.
    work_as(order.settings)
    task = order.task if isinstance(order.task, AbstractTask) else _task(order.task)
    return compute(task, order)


def compute(
    task: AbstractTask,
    order: Order,
    *,
    device: Any = None,
    stopped: Callable[[], bool] = lambda: False,
    report: Callable[[int], None] = lambda count: None,
) -> Done:
    """Compute the blocks of an `order` one after the other.

    **Arguments:**

    - `task`: the task of the order.
    - `order`: what is asked for.
    - `device`: of JAX, on which it is computed; None: the default.
    - `stopped`: asked before each block; where it says so, the rest is left.
    - `report`: called with the number of cases of each block that is finished.

    **Raises:** `InputError` where the shard cannot be written; and, after what is finished has been written, whatever
        ended the work, such as a `KeyboardInterrupt`.
    """
    if order.folder is not None:
        file = shard_file(order.folder, np.concatenate([block.places for block in order.blocks]))
        if file.exists():  # of a worker that was lost before it could say so
            return _done(read_shard(file), 0.0, True)
    start = time.perf_counter()
    outcomes: list[Outcome] = []
    try:
        with nullcontext() if device is None else jax.default_device(device):
            for block in order.blocks:
                if stopped():
                    break
                outcomes.append(task.compute(order.seed, block))
                report(len(block.places))
    except BaseException:  # what is finished stays, whatever happened
        _finish(outcomes, order, start)
        raise
    return _finish(outcomes, order, start)


def _finish(outcomes: list[Outcome], order: Order, start: float) -> Done:
    if not outcomes:
        return Done(0, 0, 0.0, 0, None)
    places = [block.places for block in order.blocks[: len(outcomes)]]
    shard = shard_of(places, outcomes)
    seconds = time.perf_counter() - start
    if order.folder is not None:
        write_shard(order.folder, shard)
    return _done(shard, seconds, order.folder is not None)


def _done(shard: Shard, seconds: float, written: bool) -> Done:
    size = sum(values.nbytes for values in shard.outcome.values.values())
    return Done(len(shard.places), shard.failed, seconds, size, None if written else shard)


def packed(task: AbstractTask) -> bytes:
    """A `task` as bytes, for another process; functions without a place of their own by cloudpickle, where it is there.

    **Raises:** `InputError` where the function cannot be sent to another process.
    """
    function = getattr(task, "function", None)
    cloudpickle = importlib.util.find_spec("cloudpickle") is not None
    # What stands in a script or a notebook is not found by other processes under its name.
    if getattr(function, "__module__", None) == "__main__" and cloudpickle:
        return _by_value(task)
    try:
        return pickle.dumps(task)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        if cloudpickle:
            return _by_value(task)
        name = type(task).__name__ if function is None else name_of(function)
        raise InputError(
            f"{name} cannot be sent to another process ({error})",
            place="`executor`",
            cure="Let the function stand at the top of a module, or install cloudpickle",
        ) from error


def _by_value(task: AbstractTask) -> bytes:
    import cloudpickle

    return cloudpickle.dumps(task)


@functools.lru_cache(maxsize=8)
def _task(content: bytes) -> AbstractTask:
    """The task of these bytes: always the same object, so that its function is compiled once in a process."""
    return pickle.loads(content)
