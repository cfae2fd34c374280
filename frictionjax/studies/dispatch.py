"""Who computes the chunks of a study: this process, its devices or the workers of an executor; and their size."""

import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED as FIRST
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from frictionjax.core import InputError
from frictionjax.studies.worker import Done

Numbers = Int[np.ndarray, " k"]
"""The numbers of blocks, shape `(k,)`."""

SECONDS = 5.0
"""How long a chunk takes, about: what a kill may cost, and long beside what a chunk costs beyond its cases."""
MOST = 5000
"""Cases in a chunk, at most."""
MEMORY = 2**28
"""Bytes of the results of a chunk, at most."""
FILES = 20_000
"""Chunks of a study, at most, as each is a file: longer ones where cases take long."""
_WAIT = 0.5  # s between two looks at an executor
_UNKNOWN = 64  # chunks that an executor of unknown size is given at once


@runtime_checkable
class Submits(Protocol):
    """What is asked of an executor: `submit(function, argument)` returns a future with `done`, `result`, `exception`
    and `cancel`."""

    def submit(self, function: Callable[..., Any], argument: Any, /) -> Any:
        """Call `function` with `argument`, somewhere."""
        ...


class Chunks:
    """The blocks that are left, chunk by chunk: each as many as take a few seconds, by the time that earlier ones took.

    **Arguments:**

    - `left`: numbers of the blocks.
    - `lanes`: cases of a block.
    - `chunk`: cases of a chunk; None: by time and memory.
    - `workers`: how many compute at once.
    """

    def __init__(self, left: Numbers, lanes: int, chunk: int | None, workers: int) -> None:
        self._left, self._lanes, self._chunk, self._workers = left, lanes, chunk, workers
        self._next = 0
        self._least = math.ceil(len(left) / FILES)
        self._rate: float | None = None
        self._bytes = 0.0
        self._again: deque[Numbers] = deque()

    def learn(self, done: Done) -> None:
        """Take the time and memory of a chunk that is `done` into account."""
        if done.count and done.seconds > 0.0:
            # The best so far: the first chunk of a process also compiles.
            self._rate = max(self._rate or 0.0, done.count / done.seconds)
            self._bytes = max(self._bytes, done.size / done.count)

    def again(self, numbers: Numbers) -> None:
        """Put the blocks with these `numbers` back: their worker was lost."""
        self._again.append(numbers)

    def __bool__(self) -> bool:
        return self._next < len(self._left) or bool(self._again)

    def take(self) -> Numbers:
        """The numbers of the blocks of the next chunk."""
        if self._again:
            return self._again.popleft()
        first = self._next
        self._next = min(first + self._blocks(), len(self._left))
        return self._left[first : self._next]

    def _blocks(self) -> int:
        if self._chunk is not None:
            return max(1, self._chunk // self._lanes)
        if self._rate is None:
            return self._least
        cases = min(self._rate * SECONDS, MOST, MEMORY / max(self._bytes, 1.0))
        # Towards the end smaller ones, so that no worker waits long for another.
        share = math.ceil((len(self._left) - self._next) / (2 * self._workers))
        blocks = cases / self._lanes
        if self._workers > 1:
            blocks = min(blocks, max(share, blocks / 8.0))
        return max(int(blocks), self._least, 1)


def in_turn(chunks: Chunks, compute: Callable[[Numbers], Done]) -> Iterator[Done]:
    """Compute all `chunks` in this thread, by `compute`."""
    while chunks:
        done = compute(chunks.take())
        chunks.learn(done)
        yield done


class WorkersLost(RuntimeError):
    """Workers were lost, and the study cannot go on; its text says what is finished and how to go on."""


class Lost(NamedTuple):
    """A chunk whose worker was lost: the `error` that said so."""

    error: BaseException


def on_executor(
    chunks: Chunks,
    submit: Callable[[Numbers], Any],
    workers: int | None,
    watch: Callable[[], None],
) -> Iterator[Done | Lost]:
    """Compute all `chunks` by the workers of an executor.

    **Arguments:**

    - `chunks`: what is left.
    - `submit`: gives the blocks with these numbers to a worker, and returns a future.
    - `workers`: how many there are; None: unknown.
    - `watch`: called at least once a second.

    **Returns:** what was done, as it is; a chunk whose worker was lost is tried once more.

    **Raises:** whatever a task raised that is not the failure of a case; the error of an executor that has come to its
        end, and `WorkersLost`.
    """
    window = _UNKNOWN if workers is None else 2 * workers
    pending: dict[Any, Numbers] = {}
    lost: set[int] = set()
    try:
        while chunks or pending:
            while chunks and len(pending) < window:
                numbers = chunks.take()
                pending[submit(numbers)] = numbers
            for future in _finished(pending):
                numbers = pending.pop(future)
                error = future.exception()
                if error is None:
                    done = future.result()
                    chunks.learn(done)
                    yield done
                elif _is_a_loss(error) and int(numbers[0]) not in lost:
                    lost.add(int(numbers[0]))
                    chunks.again(numbers)
                    yield Lost(error)
                elif _is_a_loss(error):
                    raise WorkersLost(str(error)) from error
                else:
                    raise error
            watch()
    finally:
        for future in pending:
            future.cancel()


def _finished(pending: dict[Any, Numbers]) -> list[Any]:
    """Futures of `pending` that have ended, after a short wait where none has."""
    if all(isinstance(future, Future) for future in pending):
        return list(wait(pending, timeout=_WAIT, return_when=FIRST).done)
    ready = [future for future in pending if future.done()]
    if not ready:
        time.sleep(_WAIT)
    return ready


def _is_a_loss(error: BaseException) -> bool:
    """Whether an `error` says that one worker was lost, while others go on."""
    return type(error).__module__.split(".")[0] == "distributed" and not isinstance(error, BrokenExecutor)


class Devices:
    """A thread for each of `devices` of JAX, which compute chunks by `compute(numbers, device)`."""

    def __init__(self, devices: Sequence[Any], compute: Callable[[Numbers, Any], Done]) -> None:
        self._compute = compute
        self._idle: queue.SimpleQueue = queue.SimpleQueue()
        for device in devices:
            self._idle.put(device)
        self._threads = ThreadPoolExecutor(len(devices))
        self.stopping = threading.Event()

    def submit(self, numbers: Numbers) -> Future:
        """Compute the blocks with these `numbers` on the next device that is idle."""
        return self._threads.submit(self._on_one, numbers)

    def _on_one(self, numbers: Numbers) -> Done:
        device = self._idle.get()
        try:
            return self._compute(numbers, device)
        finally:
            self._idle.put(device)

    def close(self) -> None:
        """Let each device finish its block, and end the threads."""
        self.stopping.set()
        self._threads.shutdown(wait=True, cancel_futures=True)


def workers_of(executor: Any) -> int | None:
    """How many workers an `executor` has, where it says so."""
    client = getattr(executor, "_client", None)
    if client is not None and hasattr(client, "nthreads"):
        return sum(client.nthreads().values()) or None
    found = getattr(executor, "_max_workers", None)
    return found if isinstance(found, int) and found > 0 else None


def refuse_fork(executor: Any) -> None:
    """Raise `InputError` for a pool of processes that `fork` copies from this one."""
    if not callable(getattr(executor, "submit", None)):
        raise InputError(
            f"a {type(executor).__name__} has no `submit`",
            place="`executor`",
            cure="Give an executor of concurrent.futures, or `Client.get_executor()` of Dask",
        )
    context = getattr(executor, "_mp_context", None)
    if context is not None and context.get_start_method() == "fork":
        raise InputError(
            "its processes are copied from this one by `fork`, in which JAX would wait for ever",
            place="`executor`",
            cure='Make it by ProcessPoolExecutor(n, mp_context=multiprocessing.get_context("spawn"))',
        )
