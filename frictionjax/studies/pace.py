"""The progress of a study in words: how many cases are finished, how fast, and how long the rest takes."""

import threading
import time

from frictionjax.core import Progress

_EVERY = 0.2  # s between two reports


class Pace:
    """Counts finished cases, from any thread, and reports them.

    **Arguments:**

    - `report`: whom it reports to, in the thread that calls `show`.
    - `size`: number of cases of the study.
    - `before`: how many were finished before.
    """

    def __init__(self, report: Progress, size: int, before: int) -> None:
        self._report, self._size, self._before = report, size, before
        self._done, self._failed = before, 0
        self._lock = threading.Lock()
        self._started = self._shown = time.perf_counter()
        self._first: float | None = None

    def start(self, stage: str) -> None:
        """The first sign, before anything is computed: the `stage`."""
        self._report(stage, self._done / self._size)

    def count(self, cases: int) -> None:
        """So many more `cases` are finished; nothing is reported."""
        with self._lock:
            if self._first is None:
                # The time of the first block is that of the compiler, mostly: it says nothing of the rest.
                self._first, self._before = time.perf_counter(), self._before + cases
            self._done += cases

    def failed(self, cases: int) -> None:
        """So many `cases` of those that are finished have failed."""
        with self._lock:
            self._failed += cases

    def add(self, cases: int, failed: int = 0) -> None:
        """So many more `cases` are finished, of which some have `failed`; it is reported."""
        self.count(cases)
        self.failed(failed)
        self.show()

    def show(self) -> None:
        """Report, unless a moment ago."""
        now = time.perf_counter()
        if now - self._shown >= _EVERY or self._done == self._size:
            self._shown = now
            if self._first is not None:
                self._report(self.words(now), self._done / self._size)

    def words(self, now: float) -> str:
        """What is reported at the time `now`, s."""
        with self._lock:
            done, failed, first = self._done, self._failed, self._first
        text = f"{done:,} of {self._size:,} cases"
        if first is not None and done > self._before and now > first:
            rate = (done - self._before) / (now - first)
            text += f", {rate:.3g}/s"
            if done < self._size:
                text += f", {span((self._size - done) / rate)} left"
        return text + (f", {failed:,} failed" if failed else "")


def span(seconds: float) -> str:
    """A time in words: `seconds`, minutes, hours or days."""
    for size, name in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.0f} s"
