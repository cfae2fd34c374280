"""How much an effect changes the prediction of the held-out recordings, over the noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from .cases import experiments_of, knobs_of
from .recorder import record

_SECONDS = 6.0  # of each held-out recording: enough for every regime that it holds
_STARTS = 2  # predictions within one horizon
_SUBSTEPS = 8
_BASE = ("J", "s0", "s1", "s2", "fc", "fs", "vs")
_STEP = 0.02


def visibility(
    seed: int, missing: tuple[str, ...], strength: str, families: str, rate: float, horizon: float
) -> dict[str, float]:
    """Of each effect of `missing`: root mean square by which predictions `horizon` (s) ahead differ with and without it
    on the held-out recordings, over that of the errors with it.

    Both start from states that the same observer has corrected by the measurement. What the base model's parameters
    could take up, to first order, counts as not visible: it is projected out, on the held-out recordings themselves.
    """
    plant, knobs, _, _ = knobs_of(seed, missing, strength, families, rate)
    kind, models = plant.kind, []
    for effect in missing:
        others = tuple(name for name in missing if name != effect)
        without = knobs_of(seed, others, strength, families, rate, kind)[1]
        if effect == "gravity_pendulum":
            without["grav"] = 0.0
        bases = [without.copy() for _ in _BASE]
        for base, name in zip(bases, _BASE, strict=True):
            base[name] *= 1.0 + _STEP
        models += [without, *bases]
    noise, shown = [], []
    for experiment in experiments_of(seed, plant, families, rate):
        if experiment.role == "holdout":
            part = dataclasses.replace(experiment, command=experiment.command[: round(_SECONDS * rate)])
            recording, _, hidden = record(
                part, plant, knobs, {}, seed, _SUBSTEPS, horizon=horizon, rivals=models, starts=_STARTS
            )
            scored = np.isfinite(hidden.ahead)
            noise.append((recording["x"] - hidden.ahead)[scored])
            shown.append((hidden.rivals - hidden.ahead)[:, scored])
    return _over_noise(missing, np.concatenate(noise), np.concatenate(shown, axis=1))


def _over_noise(missing: tuple[str, ...], noise: np.ndarray, shown: np.ndarray) -> dict[str, float]:
    """The ratio of each effect; `shown` holds for each the difference without it, then without it and with one base
    parameter changed."""
    found = {}
    for number, effect in enumerate(missing):
        own = shown[number * (len(_BASE) + 1) : (number + 1) * (len(_BASE) + 1)]
        taken_up = (own[1:] - own[0]).T
        size = np.sqrt(np.sum(taken_up**2, axis=0))
        left = (
            own[0]
            - taken_up
            / np.where(size > 0.0, size, 1.0)
            @ np.linalg.lstsq(taken_up / np.where(size > 0.0, size, 1.0), own[0], rcond=1e-6)[0]
        )
        found[effect] = float(np.sqrt(np.mean(left**2) / np.mean(noise**2)))
    return found
