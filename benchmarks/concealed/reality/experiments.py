"""What a test engineer would record: open loop below break-away, closed loop in sliding, on one common clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import signals
from .controllers import Loop, loop_of
from .families import RECIPES
from .plants import Plant
from .signals import RATE


@dataclass(frozen=True)
class Experiment:
    """One planned recording: `command` is the input (open loop) or the reference (closed loop), one value a sample;
    `control` is the family's own position loop, if it has one."""

    name: str
    role: str
    loop: str
    start_time: float
    command: np.ndarray
    trip: float = np.inf
    rate: float = RATE
    control: Loop | None = None


Maker = Callable[[np.random.Generator, Plant, float, float], np.ndarray]

# Name of a recording -> loop, duration in the default set (s), and what makes its command.
MAKERS: dict[str, tuple[str, float, Maker]] = {
    "noise_small": ("open", 16.0, lambda rng, p, t, f: signals.binary_noise(rng, p, t, 0.06, 0.15, f)),
    "noise_large": ("open", 16.0, lambda rng, p, t, f: signals.binary_noise(rng, p, t, 0.25, 0.42, f)),
    "breakaway": ("open", 10.0, signals.ramp),
    "stick_sine": ("open", 12.0, signals.slow_sine),
    "stick_steps": ("open", 14.0, signals.steps),
    "stick_triangle": ("open", 12.0, signals.nested_triangles),
    "moves": ("closed", 14.0, signals.moves),
    "sweep": ("closed", 12.0, signals.wander),
    "constant_speed": ("closed", 14.0, signals.constant_speeds),
    "chirp": ("open", 14.0, signals.chirp),
    "pulses": ("open", 14.0, signals.pulses),
    "jog": ("closed", 16.0, signals.jog),
    "holdout_stick": ("open", 8.0, signals.stick_multisine),
    "holdout_moves": ("closed", 14.0, signals.moves),
}

_DEFAULT = (
    "noise_small",
    "noise_large",
    "breakaway",
    "stick_sine",
    "moves",
    "sweep",
    "holdout_stick",
    "holdout_moves",
)
_RICH = (*_DEFAULT[:4], "stick_steps", "stick_triangle", *_DEFAULT[4:6], "constant_speed", *_DEFAULT[6:])

# Family -> recordings and the factor on their durations. "few" and "mixed" draw theirs.
FAMILIES: dict[str, tuple[tuple[str, ...], float]] = {
    "default": (_DEFAULT, 1.0),
    "short": (_DEFAULT, 0.5),
    "rich": (_RICH, 1.0),
    "presliding": (
        ("noise_small", "noise_large", "stick_sine", "stick_steps", "stick_triangle", "holdout_stick"),
        1.0,
    ),
    "sliding": (("moves", "sweep", "constant_speed", "holdout_moves"), 1.0),
    "odd": (("chirp", "pulses", "jog", "holdout_stick", "holdout_moves"), 1.0),
    "few": ((), 1.0),
    "mixed": ((), 1.0),
    **{family: (tuple(recipe[0] for recipe in recipes), 1.0) for family, recipes in RECIPES.items()},
}


def _choose(rng: np.random.Generator, family: str) -> tuple[tuple[str, ...], float]:
    if family not in FAMILIES:
        raise ValueError(f"unknown family of experiments {family!r}; known: {', '.join(FAMILIES)}")
    names, stretch = FAMILIES[family]
    if names:
        return names, stretch
    stick = [str(n) for n in rng.permutation(["noise_large", "stick_sine", "stick_steps", "stick_triangle"])]
    slide = [str(n) for n in rng.permutation(["moves", "sweep", "constant_speed"])]
    if family == "few":
        return (stick[0], slide[0], "holdout_stick", "holdout_moves"), 1.0
    picked = ("noise_small", *stick[:2], "breakaway", *slide[:2], "holdout_stick", "holdout_moves")
    return picked, float(rng.uniform(0.6, 1.2))


def _plan_own(
    rng: np.random.Generator,
    control_rng: np.random.Generator,
    plant: Plant,
    family: str,
    rate: float,
    stretch: float,
) -> list[Experiment]:
    """Experiments of a family of `families.py`, all with one loop."""
    control = loop_of(control_rng, plant, family, rate)
    clock, planned = 0.0, []
    for name, loop, low, high, make in RECIPES[family]:
        own = np.random.default_rng(rng.integers(2**63))
        duration = round(own.uniform(low, high) * stretch, 1)
        trip = (0.15 if name == "torque_ramps" else 0.5) * plant.stroke
        role = "holdout" if name.startswith("holdout") else "fit"
        command = make(own, plant, duration, rate)
        closed = control if loop == "closed" else None
        planned.append(Experiment(name, role, loop, clock, command, trip, rate, closed))
        clock += float(np.ceil(duration + rng.uniform(5.0, 25.0)))
    return planned


def plan(
    rng: np.random.Generator,
    plant: Plant,
    family: str = "default",
    rate: float = RATE,
    stretch: float = 1.0,
    control_rng: np.random.Generator | None = None,
) -> list[Experiment]:
    """Experiments of a family with random levels and times, in the order they are made.

    `rate` is in samples a second; `stretch` is a factor on the family's durations; `control_rng` sets the position loop
    of the families that have one of their own (default: `rng`).
    """
    if family in RECIPES:
        return _plan_own(rng, control_rng or rng, plant, family, rate, stretch)
    names, own_stretch = _choose(rng, family)
    stretch *= own_stretch
    clock, planned = 0.0, []
    for name in names:
        loop, duration, make = MAKERS[name]
        duration = round(duration * stretch, 1)
        # One child generator each, so that a recording does not depend on those before it.
        command = make(np.random.default_rng(rng.integers(2**63)), plant, duration, rate)
        trip = 0.15 * plant.stroke if name == "breakaway" else 0.5 * plant.stroke
        role = "holdout" if name.startswith("holdout") else "fit"
        planned.append(Experiment(name, role, loop, clock, command, trip, rate))
        clock += float(np.ceil(duration + rng.uniform(12.0, 25.0)))
    return planned
