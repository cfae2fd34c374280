"""Simulated tribometer cases: imposed motions of two kinds to fit, and others of the same kinds held out."""

from typing import Literal

import numpy as np
from helpers_plants import ROTARY

from frictionjax.recordings import Case, Plant, Recording
from frictionjax.simulation import simulate_imposed

RATE = 1000.0
SAMPLES = 3000
NOISE = 2e-3
"""Standard deviation of the measured force, N m: 0.3 % of break-away."""


def triangles(scale=1.0):
    """Loops of ever larger stroke, from a third of the bristle's deflection to sliding, in equal times."""
    turns = [0.0, 1e-4, -1e-4, 3e-4, -3e-4, 1e-3, -1e-3, 6e-3, -6e-3, 2e-2, -2e-2, 0.0]
    return scale * np.interp(np.arange(SAMPLES) / SAMPLES, np.linspace(0.0, 1.0, len(turns)), turns)


def sines(scale=1.0):
    """Sliding at all speeds up to 0.3 rad/s, under a quick small motion that shows the damping of the bristle."""
    t = np.arange(SAMPLES) / RATE
    large = 0.03 * np.sin(2 * np.pi * 0.9 * t) + 6e-3 * np.sin(2 * np.pi * 3.3 * t)
    return scale * (large + 1e-4 * np.sin(2 * np.pi * 23.0 * t))


def measured(name, x, *, drive=ROTARY, role: Literal["fit", "holdout"] = "fit", seed=0, more=None):
    """The friction force of `drive` under the imposed motion `x`, with `more(x)` beside it and white noise."""
    force = np.asarray(simulate_imposed(drive, x, RATE).friction) + (0.0 if more is None else more(x))
    force = force + NOISE * np.random.default_rng(seed).standard_normal(x.size)
    return Recording(name, RATE, np.zeros(x.size), x, role=role, drive="motion", force=force)


def motion_case(drive=ROTARY, more=None):
    """Triangles and sines to fit, smaller ones that run backwards held out."""
    parts: tuple[tuple[str, np.ndarray, Literal["fit", "holdout"]], ...] = (
        ("triangles", triangles(), "fit"),
        ("sines", sines(), "fit"),
        ("held_triangles", triangles(0.8)[::-1].copy(), "holdout"),
        ("held_sines", sines(0.8)[::-1].copy(), "holdout"),
    )
    recordings = tuple(
        measured(name, x, drive=drive, role=role, seed=seed, more=more)
        for seed, (name, x, role) in enumerate(parts)
    )
    return Case("tribometer", Plant(position_unit="rad", force_unit="N*m"), recordings)
