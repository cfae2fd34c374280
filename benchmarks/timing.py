"""How every benchmark measures: medians of interleaved repeats, compilation apart, and which machine it was."""

import contextlib
import os
import platform
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental.compilation_cache.compilation_cache import reset_cache

from frictionjax.core.programs import forget_programs

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def first_call(run: Callable[[], Any]) -> float:
    """Seconds of the first call of `run`, compilation included."""
    start = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - start


@contextlib.contextmanager
def all_compiled_anew() -> Iterator[None]:
    """Within it, nothing that was compiled before is found: neither in this process nor on disk."""
    kept = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    jax.clear_caches()
    forget_programs()
    reset_cache()  # JAX asks once in a process whether programs are kept on disk
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", kept)
        reset_cache()


def medians(runs: dict[str, Callable[[], Any]], *, repeats: int = 7) -> dict[str, float]:
    """Median seconds of each of `runs`, which take turns: what the machine does meanwhile hits them alike.

    Each must have been called before, so that nothing is compiled here. A turn begins with a call that does not count:
    the caches and threads that the run before has left are not this one's fault.
    """
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            jax.block_until_ready(run())
            start = time.perf_counter()
            jax.block_until_ready(run())
            seconds[name].append(time.perf_counter() - start)
    return {name: float(np.median(values)) for name, values in seconds.items()}


def machine() -> dict[str, Any]:
    """Processor, cores, memory, versions: what a number is worth nothing without."""
    processor, memory = platform.processor() or platform.machine(), None
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next((line.split(":", 1)[1].strip() for line in lines if "model name" in line), processor)
        family, model = (
            next((line.split(":")[1].strip() for line in lines if line.split(":")[0].strip() == key), "?")
            for key in ("cpu family", "model")
        )
        processor += f" (family {family}, model {model})"
        kilobytes = next(
            line for line in Path("/proc/meminfo").read_text().splitlines() if "MemTotal" in line
        )
        memory = round(int(kilobytes.split()[1]) / 2**20, 1)
    return {
        "processor": processor,
        "cores": CORES,
        "memory_GiB": memory,
        "load_before": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "jax": jax.__version__,
        "devices": [str(device) for device in jax.devices()],
    }


def row(what: str, value: float, unit: str, goal: str = "", met: bool | None = None) -> dict[str, Any]:
    """One line of a table: `what` was measured, its `value` and `unit`, the `goal` in words and whether it is met."""
    return {
        "what": what,
        "value": float(value),
        "unit": unit,
        "goal": goal,
        "met": None if met is None else bool(met),
    }
