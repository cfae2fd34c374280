"""How much of a verb's time JAX spent on compilation, reported apart from the run time."""

import threading
import time
from typing import ClassVar

import jax

_EVENT = "/jax/core/compile/backend_compile_duration"


class CompileClock:
    """Time during which this process compiles, by whatever thread; `seconds` since this clock was made.

    Threads that compile at one time count once, so that it is never more than the time that has passed.
    """

    _intervals: ClassVar[list[tuple[float, float]]] = []
    _lock: ClassVar[threading.Lock] = threading.Lock()
    _listening = False

    def __init__(self) -> None:
        if not CompileClock._listening:
            jax.monitoring.register_event_duration_secs_listener(CompileClock._note)
            CompileClock._listening = True
        self._made = time.perf_counter()

    @staticmethod
    def _note(event: str, duration_secs: float, **_: str | int) -> None:
        if event == _EVENT:
            CompileClock.compiled(duration_secs, time.perf_counter())

    @staticmethod
    def compiled(seconds: float, end: float) -> None:
        """Note that a thread compiled for so many `seconds` until `end`, of `time.perf_counter()`."""
        with CompileClock._lock:
            begin, known = end - seconds, CompileClock._intervals
            while known and known[-1][1] >= begin:
                earlier, later = known.pop()
                begin, end = min(begin, earlier), max(end, later)
            known.append((begin, end))

    @property
    def seconds(self) -> float:
        """Time during which something was compiled since this clock was made, s."""
        with CompileClock._lock:
            return sum(end - max(begin, self._made) for begin, end in self._intervals if end > self._made)


class Stages:
    """Wall-clock time of the stages of a computation, s."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._start = self._last = time.perf_counter()

    def stage(self, name: str) -> None:
        """The stage `name` ends now."""
        now = time.perf_counter()
        self.seconds[name] = round(now - self._last, 2)
        self._last = now

    def report(self, compiling: CompileClock) -> dict[str, float]:
        """The seconds of each stage, what `compiling` took of them, and the total."""
        total = time.perf_counter() - self._start
        return {**self.seconds, "compile": round(compiling.seconds, 2), "total": round(total, 2)}
