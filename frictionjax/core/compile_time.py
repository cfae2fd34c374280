"""How much of a verb's time JAX spent on compilation, reported apart from the run time."""

import time

import jax

_EVENT = "/jax/core/compile/backend_compile_duration"


class CompileClock:
    """Sums the compilation time of this process; `seconds` since this clock was made."""

    _total = 0.0
    _listening = False

    def __init__(self) -> None:
        if not CompileClock._listening:
            jax.monitoring.register_event_duration_secs_listener(CompileClock._note)
            CompileClock._listening = True
        self._before = CompileClock._total

    @staticmethod
    def _note(event: str, duration_secs: float, **_: str | int) -> None:
        if event == _EVENT:
            CompileClock._total += duration_secs

    @property
    def seconds(self) -> float:
        """Compilation time since this clock was made, s (of all threads together)."""
        return CompileClock._total - self._before


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
