"""How a long verb reports its progress, whoever listens: by default a bar where a person watches."""

import shutil
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any, Protocol, runtime_checkable

from tqdm.std import tqdm

_FORM = "{percentage:3.0f} % |{bar:24}| {elapsed}  {desc}"


@runtime_checkable
class Progress(Protocol):
    """Called by the verbs as work goes on: `progress(stage, fraction)` with `fraction` of the whole in [0, 1]."""

    def __call__(self, stage: str, fraction: float) -> None: ...


def silent(stage: str, fraction: float) -> None:
    """The `Progress` that reports nothing: `stage` and `fraction` are ignored."""


COUNT = " · "
"""Between a stage and how many of its tasks are done."""


class Counting(Executor):
    """An executor that says how many of the tasks of each `map` are done.

    **Arguments:** `executor` runs them, by threads; `progress` is called when one is done, with the `stage` and that
    count, and the part of the whole from `start` to `stop` by the tasks of the first `map`; those of later ones, which
    go on with some of these, leave it where it is.
    """

    def __init__(self, executor: Executor, progress: Progress, stage: str, start: float, stop: float) -> None:
        self._executor, self._progress, self._stage = executor, progress, stage
        self._start, self._stop = start, stop
        self._reached, self._lock = start, threading.Lock()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As of the executor itself."""
        return self._executor.submit(fn, *args, **kwargs)

    def map(self, fn: Callable[..., Any], *iterables: Iterable[Any], **how: Any) -> Iterator[Any]:
        """As of the executor itself, and counted."""
        tasks, done = list(zip(*iterables, strict=False)), 0

        def counted(task: tuple[Any, ...]) -> Any:
            nonlocal done
            found = fn(*task)
            with self._lock:
                done += 1
                here = self._start + (self._stop - self._start) * done / len(tasks)
                self._reached = max(self._reached, here)
                self._progress(f"{self._stage}{COUNT}{done} of {len(tasks)}", self._reached)
            return found

        return self._executor.map(counted, tasks, **how)


@contextmanager
def reporting(progress: Progress | bool) -> Iterator[Progress]:
    """The `Progress` that a verb reports to, while it works.

    **Arguments:**

    - `progress`: a `Progress` of the caller's own; True: a bar on stderr if that is a terminal or a notebook, else
        nothing; False: nothing.

    **Returns:** a context that gives the `Progress` and removes the bar at its end, whatever happens in between.
    """
    if not isinstance(progress, bool):
        yield progress
    elif not (progress and is_watched()):
        yield silent
    else:
        # On a terminal that does not say its size, as in many containers, tqdm alone would draw nothing.
        size = shutil.get_terminal_size()
        shown = {"file": sys.stderr, "ncols": size.columns, "nrows": size.lines}
        bar = tqdm(total=1.0, bar_format=_FORM, leave=False, **shown)

        def show(stage: str, fraction: float) -> None:
            bar.n = max(bar.n, min(fraction, 1.0))
            bar.set_description_str(stage)

        try:
            yield show
        finally:
            bar.close()


def is_watched() -> bool:
    """Whether stderr is a terminal, or the output of a notebook."""
    return sys.stderr.isatty() or _in_notebook()


def _in_notebook() -> bool:
    ipython: Any = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None
