"""Search without derivatives, for a second inertia behind a gap.

Which contact comes first, and when, changes with any number of the coupling: derivatives by it are those of a chaotic
motion, and descents stay where they begin. So models are drawn around the best so far, a few side by side, in ever
narrower circles. Each keeps the viscous friction of the whole, sigma2 + drag ratio J, which any sliding shows: how much
of it is the load's own decides when the gap is crossed.
"""

import itertools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.joint import LANES, Joint
from frictionjax.physics import Drive

_RATIOS, _GAPS, _FREQUENCIES = (0.15, 0.35), (0.3, 1.0, 3.0, 10.0, 30.0), (60.0, 200.0)
_DAMPING, _LOADS_OWN = 0.2, 0.5  # damping ratio in contact; the load's part of the viscous friction
_NARROWER = 0.8  # factor on the width after a round in which nothing was better
_LEAST_LEFT = 0.05  # of the viscous friction that stays with the motor


def coupled_starts(joint: Joint, vector: Float[Array, " q"], deflection: float) -> list[Float[Array, " q"]]:
    """`vector` of a model whose last effect is a second inertia behind a gap, at a grid of its numbers: gaps from a
    third to thirty times the bristle's break-away `deflection` (position units)."""
    place = len(joint.setting.drive.effects) - 1
    whole = joint.drive(vector)
    viscous = _viscous(whole)
    starts = []
    for ratio, gap, frequency in itertools.product(_RATIOS, _GAPS, _FREQUENCIES):
        drag = _LOADS_OWN * viscous / (ratio * float(whole.J))
        values = {
            "ratio": ratio,
            "gap": gap * deflection,
            "frequency": frequency,
            "damping": _DAMPING,
            "drag": drag,
        }
        new = np.array(vector)
        for name, value in values.items():
            index = _place(joint, f"effects.{place}.{name}")
            new[index] = np.log(value) if joint.layout[index].parameter.transform == "log" else value
        starts.append(_balanced(joint, new, viscous))
    return starts


def searched(
    joint: Joint, starts: list[Float[Array, " q"]], *, rounds: int, width: float
) -> Float[Array, " q"]:
    """The best of `starts`, moved where the misfit of the fitted recordings is least.

    **Arguments:**

    - `joint`: a model whose last effect is a second inertia; its numbers, and no others, are drawn.
    - `starts`: vectors of it, shape `(q,)`.
    - `rounds`: of as many draws as are simulated side by side.
    - `width`: of the first circle, in logarithms.
    """
    rng = np.random.default_rng(20021)
    own = f"effects.{len(joint.setting.drive.effects) - 1}."
    places = [i for i, free in enumerate(joint.layout) if free.path.startswith(own)]
    misfits = joint.misfits(starts)
    vector, least = np.array(starts[int(np.argmin(misfits))]), float(np.min(misfits))
    for _ in range(rounds):
        viscous, drawn = _viscous(joint.drive(jnp.asarray(vector))), []
        for _ in range(LANES):
            new = vector.copy()
            for i in places:
                change = width * rng.standard_normal()
                if joint.layout[i].parameter.transform == "log":
                    new[i] += change
                else:
                    new[i] *= np.exp(change)
            drawn.append(_balanced(joint, new, viscous))
        misfits = joint.misfits(drawn)
        best = int(np.argmin(misfits))
        if misfits[best] < least:
            vector, least = np.array(drawn[best]), float(misfits[best])
        else:
            width *= _NARROWER
    return jnp.asarray(vector)


def _viscous(drive: Drive) -> float:
    """Viscous friction of the motor and, where it has one of its own, of the load."""
    side = drive.load_side
    own = 0.0 if side is None else float(side.drag * side.ratio * drive.J)
    return float(drive.friction.sigma2) + own


def _balanced(joint: Joint, vector: np.ndarray, viscous: float) -> Float[Array, " q"]:
    """`vector` with the sigma2 at which the viscous friction of the whole is `viscous`."""
    moved = jnp.asarray(vector)
    drive = joint.drive(moved)
    now = float(drive.friction.sigma2)
    left = max(viscous - (_viscous(drive) - now), _LEAST_LEFT * viscous)
    return moved.at[_place(joint, "friction.sigma2")].add(np.log(left / now))


def _place(joint: Joint, path: str) -> int:
    return next(i for i, free in enumerate(joint.layout) if free.path == path)
