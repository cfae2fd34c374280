"""Every effect a case can conceal, by name, and how strong it is.

An effect is a function of a random stream, a plant and a size (1 = strong); it returns the knobs it turns and the
physical sizes that go into the truth. Where nature has several forms of one effect, the stream draws one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from .effects_drive import DRIVE, DRIVE_EXTRA
from .effects_friction import FRICTION, FRICTION_EXTRA
from .effects_outside import OUTSIDE_EFFECTS
from .forms import FORMS
from .plants import Plant, log_uniform

STRENGTHS = {"strong": 1.0, "medium": 1.0 / 3.0, "weak": 0.1}

_OTHER_FORM = 0.5  # share of effects in the newer families whose form is not the usual one

Effect = Callable[[np.random.Generator, Plant, float], tuple[dict, dict]]

EFFECTS: dict[str, Effect] = FRICTION | DRIVE | FRICTION_EXTRA | DRIVE_EXTRA | OUTSIDE_EFFECTS

CATALOGUE: tuple[str, ...] = tuple(FRICTION | DRIVE)
EXTRA: tuple[str, ...] = tuple(FRICTION_EXTRA | DRIVE_EXTRA)
OUTSIDE: tuple[str, ...] = tuple(OUTSIDE_EFFECTS)


# What an effect's sizes are measured by, where a slow recorder, a weight or a coarse encoder changes the scale.
_TIMES = ("delay", "drive_lag", "sensor_lag")
_INPUTS = ("drive_saturation", "outside:supply_sag", "outside:drive_hysteresis")
# Least deflection that the size goes by, in steps of the encoder: a play of the sensor is a tenth of it.
_GAPS = {"backlash": 6.0, "outside:loose_sensor": 30.0, "outside:sensor_drift": 30.0}
_SHORTEST_RATE = 500.0  # samples a second from which a strong delay lasts one and a half samples


def _to_scale(name: str, plant: Plant, size: float, rate: float) -> tuple[Plant, float]:
    """Plant and size as an effect of the newer families takes them: a delay is as long as samples are, a limit of the
    input as high as what moves need, and play is wider than a step of the encoder."""
    if name in _TIMES:
        return plant, size * max(_SHORTEST_RATE / rate, 1.0)
    if name in _INPUTS:
        needs = plant.Fs + plant.gravity + 0.25 * plant.J * plant.acceleration
        return dataclasses.replace(plant, Fs=needs), size
    if name in _GAPS:
        wide = max(plant.deflection, _GAPS[name] * plant.encoder_step)
        return dataclasses.replace(plant, sigma0=plant.Fs / wide), size
    return plant, size


def build(
    missing: Sequence[str],
    strength: str,
    plant: Plant,
    stream: Callable[[str], np.random.Generator],
    rate: float | None = None,
) -> tuple[dict, dict[str, dict]]:
    """Knobs that conceal all of `missing` at once, and the truth about each.

    With a `rate` (samples a second; the newer families) half of the effects have their other form, and sizes go by what
    such recordings resolve. Raises ValueError for an unknown name or strength, and for two effects that need the same
    knob.
    """
    if strength not in STRENGTHS:
        raise ValueError(f"unknown strength {strength!r}; known: {', '.join(STRENGTHS)}")
    knobs: dict = {}
    truths: dict[str, dict] = {}
    for name in missing:
        if name not in EFFECTS:
            raise ValueError(f"unknown effect {name!r}; known: {', '.join(EFFECTS)}")
        rng = stream(name)
        # The size is drawn before the form, so that strengths of one seed share both.
        size = STRENGTHS[strength] * log_uniform(rng, 1.5**-0.5, 1.5**0.5)
        if rate is None:
            turned, truth = EFFECTS[name](rng, plant, size)
        else:
            other = name in FORMS and stream(f"form of {name}").random() < _OTHER_FORM
            own, own_size = _to_scale(name, plant, size, rate)
            turned, truth = (FORMS if other else EFFECTS)[name](rng, own, own_size)
            truth = {"form": "usual"} | truth
        clash = sorted(set(turned) & set(knobs))
        if clash:
            raise ValueError(
                f"{name!r} needs what another effect of this case already uses: {', '.join(clash)}"
            )
        knobs |= turned
        truths[name] = {"size": size, **{k: v if isinstance(v, str) else _plain(v) for k, v in truth.items()}}
    return knobs, truths


def _plain(value: float | np.ndarray) -> float | list[float]:
    return np.asarray(value, float).tolist()
