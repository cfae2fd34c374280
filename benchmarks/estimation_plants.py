"""Own starting values on random plants, and closed loops: `python -m benchmarks estimation_plants`."""

import sys

import jax
import numpy as np

from benchmarks.three_regimes import ARM, LABELS, apart, draw, drive_of
from benchmarks.timing import row
from frictionjax import fit, fit_many


def plants(small: bool) -> list[dict]:
    """Its own starting values on random plants: log-uniform within a factor 3 of the arm in every parameter."""
    count, rng = (2 if small else 50), np.random.default_rng(3)
    hits, worst = [], []
    for number in range(count):
        sys.stderr.write(f"plant {number + 1}\n")
        theta = np.array(ARM) * 3.0 ** rng.uniform(-1, 1, 7)
        theta[5] = theta[4] * rng.uniform(1.1, 1.8)
        theta[2] = 2.0 * rng.uniform(0.1, 0.8) * np.sqrt(theta[1] * theta[0])
        noise = 1e-3 * theta[5] / theta[1]
        (recordings,) = draw(theta, jax.random.split(jax.random.key(number), 1), noise, 0.0, closed=False)
        anything = drive_of(apart(theta * 30.0 ** rng.uniform(-1, 1, 7)))
        own = fit(anything, recordings, encoder_step=1e-15)
        best = fit(drive_of(theta), recordings, encoder_step=1e-15, own_starts=False)
        hits.append(own.cost < best.cost + 5.0)
        off = [
            abs(own.parameters[n].value - v) / own.parameters[n].stderr
            for n, v in zip(LABELS, theta, strict=True)
        ]
        worst.append(max(off))
    return [
        row(
            f"random plants ({count}) whose own starting values reach the optimum",
            100 * np.mean(hits),
            "%",
            "100",
        ),
        row(
            "random plants: largest error of a parameter, median over plants",
            float(np.median(worst)),
            "standard errors",
        ),
    ]


def loops(small: bool) -> list[dict]:
    """Closed-loop moves, whose input carries the noise: bias of ours and of the naive inverse dynamics."""
    from benchmarks.rivals.inverse_dynamics import inverse_dynamics

    draws, noise, rows = (4 if small else 100), 1e-5, []
    sets = draw(ARM, jax.random.split(jax.random.key(11), draws), noise, 0.0, closed=True)
    found = fit_many(drive_of(ARM), sets, encoder_step=1e-15)
    for label, place in (("J", 0), ("Fc", 4), ("sigma2", 3)):
        error = found.values[:, place] / ARM[place] - 1.0
        bias, deviation = 100 * np.mean(error), 100 * np.std(error) / np.sqrt(draws)
        rows.append(row(f"closed loop: bias of {label}", float(bias), "%"))
        rows.append(
            row(f"closed loop: bias of {label} over its standard error", float(bias / deviation), "1")
        )
    for cutoff in (60.0, None):
        naive = [
            inverse_dynamics(
                [(one[2].u, one[2].x, 1.0 / one[2].sample_rate)],
                1.0,
                cutoff,
                3 * ARM[6],
                every=1 if cutoff else 10,
            )[0]
            for one in sets
        ]
        how = f"inverse dynamics, {cutoff:g} Hz filter" if cutoff else "inverse dynamics, every 10th sample"
        for label, place in (("J", 0), ("Fc", 4), ("sigma2", 3)):
            error = np.array([getattr(one, label) for one in naive]) / ARM[place] - 1.0
            rows.append(row(f"closed loop, {how}: bias of {label}", 100 * float(np.mean(error)), "%"))
            size = np.mean(error) / (np.std(error) / np.sqrt(draws))
            rows.append(row(f"closed loop, {how}: bias of {label} over its standard error", float(size), "1"))
    return rows


def measure(*, small: bool = False) -> list[dict]:
    """All rows."""
    return plants(small) + loops(small)
