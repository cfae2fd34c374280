"""Fits against the Cramer-Rao bound: `python -m benchmarks estimation_study`.

500 draws of the three-regime experiment at each of four noise levels, in open and closed loop, and with an unmeasured
force; starts up to 30 % off.
"""

import sys
import time

import jax
import numpy as np

from benchmarks.three_regimes import ARM, LABELS, apart, bound, draw, drive_of
from benchmarks.timing import row
from frictionjax import fit_many

LEVELS = (3e-8, 1e-7, 1e-6, 1e-5)  # rad: noise of the position
PUSH = 5e-4  # of Fs: the unmeasured force of the sample cases


def _coverage(values, stderr, truth) -> np.ndarray:
    return np.mean(np.abs(values - truth) < 1.96 * stderr, axis=0)


def measure(*, small: bool = False) -> list[dict]:
    """RMSE over the Cramer-Rao bound, and coverage of 95 % intervals."""
    draws, rows = (4 if small else 500), []
    truth = np.array(ARM)
    setups = [
        (noise, 0.0, closed) for closed in (False, True) for noise in (LEVELS[1:2] if small else LEVELS)
    ]
    setups += [] if small else [(LEVELS[1], PUSH * ARM[5], closed) for closed in (False, True)]
    for noise, push, closed in setups:
        keys = jax.random.split(jax.random.key(int(1e9 * noise) + closed), draws)
        sets = draw(ARM, keys, noise, push, closed=closed)
        rng = np.random.default_rng(1)
        starts = [drive_of(apart(truth * 1.3 ** rng.uniform(-1, 1, 7))) for _ in range(draws)]
        start = time.perf_counter()
        sys.stderr.write(f"noise {noise:g} rad, push {push:g}, {'closed' if closed else 'open'} loop\n")
        found = fit_many(starts, sets, encoder_step=1e-15)
        seconds = time.perf_counter() - start
        least = truth * bound(ARM, [r.u for r in sets[0]], noise)
        rmse = np.sqrt(np.mean((found.values - truth) ** 2, axis=0))
        covered = _coverage(found.values, found.stderr, truth)
        white = _coverage(found.values, np.broadcast_to(least, found.values.shape), truth)
        name = f"{'closed' if closed else 'open'} loop, noise {noise:g} rad"
        name += ", with an unmeasured force" if push else ""
        for i, label in enumerate(LABELS):
            if push:
                ratio = rmse[i] / np.mean(found.stderr[:, i])
                rows.append(row(f"{name}: rms error of {label} over its standard error", ratio, "1"))
                rows.append(
                    row(f"{name}: the same over that by J'J with white noise", rmse[i] / least[i], "1")
                )
            else:
                ratio = rmse[i] / least[i]
                rows.append(row(f"{name}: RMSE/CRLB of {label}", ratio, "1", "at most 1.05", ratio <= 1.05))
            good = 0.93 <= covered[i] <= 0.97
            rows.append(row(f"{name}: coverage of {label}", 100 * covered[i], "%", "93 to 97", bool(good)))
            if push:
                rows.append(row(f"{name}: coverage of {label} by J'J", 100 * white[i], "%"))
        still = np.mean(found.moved > 1.0)
        rows.append(row(f"{name}: fits still moving at the end", 100 * still, "%"))
        rows.append(row(f"{name}: {draws} fits, compilation included", seconds, "s"))
    return rows
