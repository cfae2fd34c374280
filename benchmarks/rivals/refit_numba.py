"""A refit of the seven LuGre parameters as anyone can write it: numba for the free run, `scipy.optimize.least_squares`
with differences for the rest, and a pool of processes for many."""

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals import numba_loop

NAMES = ("J", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
Recording = tuple[np.ndarray, np.ndarray, float]
"""Input u (n,) in input units, held between samples; position x (n,) in position units; sample time dt in s."""
# A wild step overflows; what is not a number counts as this many standard deviations.
_LARGEST = 1e6


class Info(NamedTuple):
    """How a refit went: `nfev`: free runs of the whole set of recordings, those for the differences among them;
    `success`: whether the last phase met a tolerance; `cost`: half the sum of squares of (x_sim - x) / `s_rec`."""

    nfev: int
    success: bool
    cost: float


def free_run(theta: np.ndarray, force: np.ndarray, dt: float, *, substeps: int = 2) -> np.ndarray:
    """Position (n,) in position units from rest: two-stage Rosenbrock, gamma = 1 - 1/sqrt 2, `substeps` a sample.

    `theta`: J, sigma0, sigma1, sigma2, Fc, Fs, vs, shape (7,); `force`: shape (n,), in force units, held for `dt` s.
    """
    out = np.empty(force.size)
    numba_loop.simulate(theta, force, dt, substeps, out)
    return out


def residuals(
    theta: np.ndarray, recordings: Sequence[Recording], motor_constant: float, s_rec: np.ndarray
) -> np.ndarray:
    """(x_sim - x) / `s_rec` of all recordings end to end, shape (sum of n,), finite whatever `theta` (7,) is.

    `motor_constant`: force per input unit; `s_rec`: position units, shape (recordings,).
    """
    parts = [
        (free_run(theta, motor_constant * u, dt) - x) / s
        for (u, x, dt), s in zip(recordings, s_rec, strict=True)
    ]
    stacked = np.concatenate(parts)
    return np.clip(np.nan_to_num(stacked, nan=_LARGEST), -_LARGEST, _LARGEST)


def refit(
    recordings: Sequence[Recording], motor_constant: float, start: np.ndarray, s_rec: np.ndarray
) -> tuple[np.ndarray, Info]:
    """Fit the free runs to the measured positions in two phases: residuals over the standard deviation of each
    recording's position, and from there over `s_rec`.

    `motor_constant`: force per input unit; `start`: J, sigma0, sigma1, sigma2, Fc, Fs, vs, shape (7,), of which a fifth
    and five times are the bounds; `s_rec`: standard deviation of x_sim - x at the truth, position units, shape
    (recordings,). It returns theta (7,) and `Info`.
    """
    low, high = np.log(start) - np.log(5.0), np.log(start) + np.log(5.0)
    runs = 0

    def of(logs: np.ndarray, scale: np.ndarray) -> np.ndarray:
        nonlocal runs
        runs += 1
        return residuals(np.exp(logs), recordings, motor_constant, scale)

    logs, solution = np.log(start), None
    for scale in (np.array([np.std(x) for _, x, _ in recordings]), np.asarray(s_rec)):
        inside = np.clip(logs, low + 1e-6, high - 1e-6)
        solution = least_squares(
            partial(of, scale=scale), inside, method="trf", diff_step=1e-4, bounds=(low, high)
        )
        logs = solution.x
    assert solution is not None
    return np.exp(logs), Info(runs, bool(solution.success), float(solution.cost))


def warm_up() -> None:
    """Compile what `refit` calls, on a record of ten samples."""
    theta = np.array([1.0, 1e4, 100.0, 1.0, 1.0, 1.5, 0.01])
    residuals(theta, [(np.ones(10), np.zeros(10), 1e-3)], 1.0, np.ones(1))


_READY: Any = None


def _prepare(ready: Any) -> None:
    global _READY
    _READY = ready
    warm_up()


def _meet() -> None:
    """Wait until every process has compiled, so that no compilation is in the time."""
    _READY.wait(timeout=300.0)


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Processes started inside leave the cores to one another: each has one thread for linear algebra."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def refit_many(
    sets: Sequence[Sequence[Recording]],
    motor_constant: float,
    starts: np.ndarray,
    s_rec: np.ndarray,
    *,
    processes: int = 2,
) -> tuple[np.ndarray, float, list[Info]]:
    """Refit every set of recordings, a Monte Carlo over draws: thetas (draws, 7), wall seconds, and an `Info` each.

    `starts`: shape (draws, 7), or (7,) for all; the rest as in `refit`. Each of the `processes` has compiled before the
    clock starts; sending the recordings to it counts. Call it below `if __name__ == "__main__"`: they are spawned.
    """
    context = multiprocessing.get_context("spawn")
    starts = np.broadcast_to(starts, (len(sets), len(NAMES)))
    ready = context.Barrier(processes)
    with (
        _one_blas_thread(),
        ProcessPoolExecutor(processes, context, initializer=_prepare, initargs=(ready,)) as pool,
    ):
        for met in [pool.submit(_meet) for _ in range(processes)]:
            met.result()
        begin = time.perf_counter()
        waiting = [
            pool.submit(refit, recordings, motor_constant, start, s_rec)
            for recordings, start in zip(sets, starts, strict=True)
        ]
        done = [one.result() for one in waiting]
        seconds = time.perf_counter() - begin
    return np.array([theta for theta, _ in done]), seconds, [info for _, info in done]
