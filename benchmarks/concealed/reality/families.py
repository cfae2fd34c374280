"""Experiments of the industrial, laboratory, poor and joint families: what each records, how long, and at what rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import profiles, signals
from .plants import Plant

Maker = Callable[[np.random.Generator, Plant, float, float], np.ndarray]
Recipe = tuple[str, str, float, float, Maker]

# Family -> name of a recording, its loop, its shortest and longest duration (s), and what makes its command.
RECIPES: dict[str, tuple[Recipe, ...]] = {
    "industrial": (
        ("cycle_1", "closed", 12.0, 18.0, profiles.trapezoid_moves),
        ("cycle_2", "closed", 12.0, 18.0, profiles.s_curve_moves),
        ("reversals", "closed", 14.0, 20.0, profiles.slow_reversals),
        ("sines", "closed", 10.0, 16.0, profiles.slow_sines),
        ("holdout_cycle", "closed", 10.0, 16.0, profiles.either_moves),
        ("holdout_reversals", "closed", 10.0, 16.0, profiles.slow_reversals),
    ),
    "laboratory": (
        ("torque_chirp", "open", 6.0, 9.0, signals.chirp),
        ("torque_multisine", "open", 6.0, 9.0, signals.stick_multisine),
        ("torque_ramps", "open", 6.0, 9.0, profiles.torque_ramps),
        ("position_chirp", "closed", 6.0, 9.0, profiles.position_chirp),
        ("speed_ramps", "closed", 7.0, 10.0, profiles.speed_ramps),
        ("holdout_multisine", "open", 5.0, 8.0, signals.stick_multisine),
        ("holdout_ramps", "closed", 6.0, 9.0, profiles.speed_ramps),
    ),
    "poor": (
        ("run_1", "closed", 5.0, 8.0, profiles.either_moves),
        ("holdout_run", "closed", 5.0, 8.0, profiles.either_moves),
    ),
    "joint": (
        ("moves_1", "closed", 12.0, 20.0, profiles.s_curve_moves),
        ("moves_2", "closed", 12.0, 20.0, profiles.either_moves),
        ("sines_1", "closed", 12.0, 20.0, profiles.slow_sines),
        ("sines_2", "closed", 12.0, 20.0, profiles.slow_sines),
        ("holdout_moves_1", "closed", 12.0, 18.0, profiles.s_curve_moves),
        ("holdout_sines", "closed", 12.0, 18.0, profiles.slow_sines),
    ),
}

RATES: dict[str, tuple[float, float]] = {
    "industrial": (1000.0, 1000.0),
    "laboratory": (4000.0, 4000.0),
    "poor": (500.0, 500.0),
    "joint": (50.0, 200.0),
}
"""Family -> lowest and highest rate, samples a second."""


def rate_of(rng: np.random.Generator, family: str) -> float:
    """A rate of a family, in whole samples a second."""
    low, high = RATES[family]
    return float(round(np.exp(rng.uniform(np.log(low), np.log(high)))))
