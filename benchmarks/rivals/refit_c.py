"""The refit of `refit_numba.py` with the loop in C: one pass gives the free run and, in the other lanes, its
derivatives by differences."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals import c_loop

Recording = tuple[np.ndarray, np.ndarray, float]
"""Input u (n,) in input units, held between samples; position x (n,) in position units; sample time dt in s."""
_LANES = 8
_STEP = 1e-5  # of the logarithm of a parameter
_LARGEST = 1e6  # standard deviations: what a wild step counts as


class Info(NamedTuple):
    """How a refit went: `nfev`: passes over the whole set of recordings, of eight free runs each; `success`: whether
    the last phase met a tolerance; `cost`: half the sum of squares of (x_sim - x) / `s_rec`."""

    nfev: int
    success: bool
    cost: float


class Refit:
    """The compiled loop, and `refit` with it."""

    def __init__(self) -> None:
        self._library = c_loop.build(_LANES)

    def residuals(
        self,
        logs: np.ndarray,
        recordings: Sequence[Recording],
        motor_constant: float,
        s_rec: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(x_sim - x) / `s_rec` of all recordings end to end, shape (sum of n,), two substeps a sample, and its
        derivatives by the logarithms `logs` (7,) of J, sigma0, sigma1, sigma2, Fc, Fs, vs, shape (sum of n, 7).

        `motor_constant`: force per input unit; `s_rec`: position units, shape (recordings,).
        """
        moved = np.exp(np.concatenate([logs[None], logs + _STEP * np.eye(7)]))
        values, slopes = [], []
        for (u, x, dt), s in zip(recordings, s_rec, strict=True):
            run = c_loop.runner(
                self._library, moved, motor_constant * u, dt, substeps=2, keep_all=True, lanes=_LANES
            )
            runs = run()
            values.append((runs[:, 0] - x) / s)
            slopes.append((runs[:, 1:] - runs[:, :1]) / (s * _STEP))
        return _finite(np.concatenate(values), _LARGEST), _finite(np.concatenate(slopes), _LARGEST / _STEP)

    def refit(
        self, recordings: Sequence[Recording], motor_constant: float, start: np.ndarray, s_rec: np.ndarray
    ) -> tuple[np.ndarray, Info]:
        """Theta (7,) and `Info`, with the arguments, the bounds and the two phases of `refit_numba.refit`."""
        low, high = np.log(start) - np.log(5.0), np.log(start) + np.log(5.0)
        logs, passes, success, cost = np.log(start), 0, False, np.inf
        for scale in (np.array([np.std(x) for _, x, _ in recordings]), np.asarray(s_rec)):
            # scipy asks for the Jacobian where it last asked for the residuals: one pass gives both.
            last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

            def at(logs: np.ndarray, scale=scale, last=last) -> tuple[np.ndarray, np.ndarray]:
                nonlocal passes
                if logs.tobytes() not in last:
                    passes += 1
                    last.clear()
                    last[logs.tobytes()] = self.residuals(logs, recordings, motor_constant, scale)
                return last[logs.tobytes()]

            solution = least_squares(
                lambda logs, at=at: at(logs)[0],
                np.clip(logs, low + 1e-6, high - 1e-6),
                jac=lambda logs, at=at: at(logs)[1],  # type: ignore[arg-type]
                method="trf",
                bounds=(low, high),
            )
            logs, success, cost = solution.x, bool(solution.success), float(solution.cost)
        return np.exp(logs), Info(passes, success, cost)


def _finite(values: np.ndarray, largest: float) -> np.ndarray:
    """`values`, of any shape, none of them beyond `largest` and no NaN among them."""
    return np.clip(np.nan_to_num(values, nan=largest), -largest, largest)
