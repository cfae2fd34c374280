"""Every effect a case can conceal, by name, and how strong it is.

An effect is a function of a random stream, a plant and a size (1 = strong); it returns the knobs it turns and the
physical sizes that go into the truth. Where nature has several forms of one effect, the stream draws one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .effects_drive import DRIVE, DRIVE_EXTRA
from .effects_friction import FRICTION, FRICTION_EXTRA
from .effects_outside import OUTSIDE_EFFECTS
from .plants import Plant, log_uniform

STRENGTHS = {"strong": 1.0, "medium": 1.0 / 3.0, "weak": 0.1}

Effect = Callable[[np.random.Generator, Plant, float], tuple[dict, dict]]

EFFECTS: dict[str, Effect] = FRICTION | DRIVE | FRICTION_EXTRA | DRIVE_EXTRA | OUTSIDE_EFFECTS

CATALOGUE: tuple[str, ...] = tuple(FRICTION | DRIVE)
EXTRA: tuple[str, ...] = tuple(FRICTION_EXTRA | DRIVE_EXTRA)
OUTSIDE: tuple[str, ...] = tuple(OUTSIDE_EFFECTS)


def build(
    missing: Sequence[str],
    strength: str,
    plant: Plant,
    stream: Callable[[str], np.random.Generator],
) -> tuple[dict, dict[str, dict]]:
    """Knobs that conceal all of `missing` at once, and the truth about each.

    Raises ValueError for an unknown name or strength, and for two effects that need the same knob.
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
        turned, truth = EFFECTS[name](rng, plant, size)
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
