"""Studies: refits a second, what store and executor cost, and memory against the number of draws.

`python -m benchmarks studies`; on a machine with a GPU the same draws are simulated and fitted there. `python -m
benchmarks.studies N FOLDER` makes N draws in a process of its own and prints seconds and the largest memory, as JSON.
"""

import functools
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

import jax
import numpy as np

import frictionjax as fj
from benchmarks.timing import CORES, row
from frictionjax.studies.level_sweep import table_one
from frictionjax.studies.study import Blocks

NOISE = fj.Axis("noise", [1e-9, 1e-8], unit="m")
REPOSITORY = Path(__file__).parents[1]


def responses(draws: int, lanes: int = 64) -> fj.Study:
    """So many draws of the paper's pipeline: 2 s of binary noise at 2 kHz, frequency response, Sanathanan-Koerner."""
    task = fj.ResponseTask(table_one(), fj.Experiment(samples=4096, substeps=1), lanes=lanes)
    return fj.Study(fj.Factorial(NOISE, repeats=draws // 2), task)


def refits(draws: int) -> fj.Study:
    """So many maximum-likelihood fits of a break-away by a ramp."""
    ramp = fj.Experiment("ramp", samples=1000, sample_rate=1000.0, level=2.0)
    return fj.Study(fj.Factorial(NOISE, repeats=draws // 2), fj.FitTask(table_one(), (ramp,), lanes=4))


def seconds_of(
    study: fj.Study, chunk: int | None = None, executor: ProcessPoolExecutor | None = None
) -> float:
    """Seconds of a study with a store, on one device or on an executor."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        one = jax.local_devices()[:1]
        fj.run_study(study, Path(folder) / "s.zarr", executor, chunk=chunk, devices=one, progress=False)
        return time.perf_counter() - start


def alone(study: fj.Study) -> float:
    """Seconds of the task itself for all cases of a study: no store, no executor, no data set."""
    blocks = Blocks(study)
    start = time.perf_counter()
    with jax.default_device(jax.local_devices()[0]):
        for block in blocks.take(np.arange(len(blocks))):
            study.task.compute(study.seed, block)
    return time.perf_counter() - start


def pool(workers: int, *, pinned: bool = False) -> ProcessPoolExecutor:
    """Processes that are spawned; `pinned`, each to a core of its own, where the system can: left alone, one process
    computes on more than one."""
    spawn = multiprocessing.get_context("spawn")
    if not (pinned and hasattr(os, "sched_setaffinity")):
        return ProcessPoolExecutor(workers, mp_context=spawn)
    return ProcessPoolExecutor(
        workers, mp_context=spawn, initializer=_take_a_core, initargs=(spawn.Value("i", 0),)
    )


def _take_a_core(taken: Synchronized) -> None:
    """Keep this process to the next core that is not `taken`, before it starts any thread."""
    cores = sorted(os.sched_getaffinity(0))
    with taken.get_lock():
        os.sched_setaffinity(0, {cores[taken.value % len(cores)]})
        taken.value += 1


def started(executor: ProcessPoolExecutor, few: fj.Study, workers: int) -> ProcessPoolExecutor:
    """The `executor` whose `workers` have started and compiled, by a study of a `few` cases."""
    seconds_of(few, chunk=max(1, few.design.size // (2 * workers)), executor=executor)
    return executor


def side_by_side(ways: dict[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The least seconds of each of the `ways` in so many rounds, in which they take turns: an hour of a machine is
    faster or slower than another by more than what a store costs."""
    found = [{name: way() for name, way in ways.items()} for _ in range(rounds)]
    return {name: min(one[name] for one in found) for name in ways}


def measure(*, small: bool = False) -> list[dict]:
    """The rows; `small`: few draws."""
    draws, fits, rounds, large = (128, 8, 1, (128, 256)) if small else (5_120, 480, 5, (10_000, 100_000))
    workers = min(2, CORES)
    few, study = responses(128), responses(draws)
    alone(few)  # compiles
    chunk = max(64, int(draws / alone(study)) // 64 * 64)  # about a second
    with pool(1) as single, pool(1, pinned=True) as pinned, pool(workers, pinned=True) as several:
        first, core = started(single, few, 1), started(pinned, few, 1)
        all_of_them = started(several, few, workers)
        ways = {
            "bare": lambda: alone(study),
            "stored": lambda: seconds_of(study, chunk),
            "one": lambda: seconds_of(study, chunk, first),
            "core": lambda: seconds_of(study, chunk, core),
            "both": lambda: seconds_of(study, chunk, all_of_them),
        }
        least = side_by_side(ways, rounds)
        cost, far = (100 * (least[name] / least["bare"] - 1) for name in ("stored", "one"))
        gain = least["core"] / least["both"]
        rows = [
            row("simulated frequency responses and their fits, the task alone", draws / least["bare"], "1/s"),
            row("with a store, chunks of a second: overhead", cost, "%", "below 5", cost < 5.0),
            row("with a store and one other process: overhead", far, "%", "below 5", far < 5.0),
            row(f"{workers} cores against one", gain, "x", "at least 1.8", gain > 1.8),
        ]
    few, study = refits(8), refits(fits)
    with pool(1) as single, pool(1, pinned=True) as pinned, pool(workers, pinned=True) as several:
        executors = {"free": single, "one": pinned, "both": several}
        for executor in executors.values():
            started(executor, few, workers if executor is several else 1)
        # Two calls of four lanes a chunk.
        ways = {name: functools.partial(seconds_of, study, 8, one) for name, one in executors.items()}
        least = side_by_side(ways, min(2, rounds))
    gain = least["one"] / least["both"]
    rows += [
        row("refits of a break-away, one process on all cores", fits / least["free"], "1/s"),
        row("refits, one process on one core", fits / least["one"], "1/s"),
        row(f"refits, {workers} processes on a core each", fits / least["both"], "1/s"),
        row(f"refits, {workers} cores against one", gain, "x", "at least 1.8", gain > 1.8),
    ]
    found = [_in_a_process(count) for count in large]
    for count, (seconds, memory) in zip(large, found, strict=True):
        rows.append(row(f"{count} draws in a process: time of each", 1e6 * seconds / count, "us"))
        rows.append(row(f"{count} draws: largest memory", memory, "MiB"))
    growth = 100 * (found[1][1] / found[0][1] - 1)
    rows.append(row("memory grows with ten times the draws by", growth, "%", "below 10", growth < 10.0))
    if jax.default_backend() == "gpu":
        wide = responses(large[1], lanes=4096)
        seconds_of(responses(4096, lanes=4096))
        rows.append(
            row(f"{large[1]} draws on the GPU: time of each", 1e6 * seconds_of(wide) / large[1], "us")
        )
    return rows


def _in_a_process(draws: int) -> tuple[float, float]:
    """Seconds, without compilation, and MiB at most of so many draws in a new process."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "benchmarks.studies", str(draws), folder]
        done = subprocess.run(
            command, cwd=REPOSITORY, capture_output=True, text=True, check=True, env=os.environ
        )
    found = json.loads(done.stdout.splitlines()[-1])
    return found["seconds"], found["MiB"]


def main() -> None:
    """So many draws in this process."""
    fj.configure_jax()
    draws, folder = int(sys.argv[1]), Path(sys.argv[2])
    seconds_of(responses(128))
    start = time.perf_counter()
    fj.run_study(responses(draws), folder / "s.zarr", devices=jax.local_devices()[:1], progress=False)
    seconds = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(json.dumps({"seconds": seconds, "MiB": memory}) + "\n")


if __name__ == "__main__":
    main()
