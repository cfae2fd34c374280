"""Search without derivatives, for a second inertia behind a gap.

Which contact comes first, and when, changes with any number of the coupling: derivatives by it are those of a chaotic
motion, and descents stay where they begin. So models are drawn around the best so far, a few side by side, in ever
narrower circles.

A gap that is wrong by a twentieth brings no block of samples down to the noise, and costs more than none at all. So the
knee of the cost comes down from what the rigid machine misses most, and until it is at the noise more than one place is
followed.

Each model keeps the viscous friction of the whole, sigma2 + drag ratio J, which any sliding shows: how much of it is
the load's own decides when the gap is crossed.
"""

import itertools
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from frictionjax.estimation.joint import LANES, Joint, misfit_of
from frictionjax.physics import Drive

_RATIOS, _GAPS, _FREQUENCIES = (0.15, 0.35), (0.3, 1.0, 3.0, 10.0, 30.0), (60.0, 200.0)
_DAMPING, _LOADS_OWN = 0.2, 0.5  # damping ratio in contact; the load's part of the viscous friction
_NARROWER = 0.8  # factor on the width after a round in which nothing was better
_NARROWED = 0.7  # the same, after a knee
_QUANTILES = (0.98, 0.9, 0.7)  # of the block powers: the knees before that of the noise
_PROMISING = 0.1  # of what the rigid machine costs above the noise, that the first knee must gain
_KEPT = 3  # places that are followed at the widest knee, one less at each one after it
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


def wide_knees(joint: Joint, vector: Float[Array, " q"]) -> tuple[float, ...]:
    """Knees for a search from far off, from the powers of the blocks that `vector` leaves down to the noise."""
    scored = (np.asarray(joint.fitted)[:, None] > 0) & (np.asarray(joint.batch.block_count) > 0)
    power = np.nan_to_num(joint.powers([vector])[0][scored], nan=1e30, posinf=1e30)
    return (*(max(float(knee), 1.0) for knee in np.quantile(power, _QUANTILES)), 1.0)


def searched(
    joint: Joint,
    starts: list[Float[Array, " q"]],
    *,
    rounds: int,
    width: float,
    knees: Sequence[float] = (1.0,),
    rigid: Float[Array, " q"] | None = None,
) -> Float[Array, " q"] | None:
    """The best of `starts`, moved where the misfit of the fitted recordings is least.

    **Arguments:**

    - `joint`: a model whose last effect is a second inertia; its numbers, and no others, are drawn.
    - `starts`: vectors of it, shape `(q,)`.
    - `rounds`: of as many draws as are simulated side by side, at each knee.
    - `width`: of the first circle, in logarithms.
    - `knees`: powers of a block, in units of the noise, beyond which the cost is a logarithm, in turn.
    - `rigid`: a model without a gap, to be given up for something better.

    **Returns:** a vector of shape `(q,)`; None where after the first knee nothing was clearly better than `rigid`.
    """
    rng, fitted = np.random.default_rng(20021), np.asarray(joint.fitted)

    def cost(power: np.ndarray, knee: float) -> float:
        return misfit_of(power, fitted, joint.batch, knee)

    vectors, powers = [np.array(start) for start in starts], joint.powers(starts)
    for number, knee in enumerate(knees):
        order = np.argsort([cost(power, knee) for power in powers])[: max(_KEPT - number, 1)]
        vectors, powers = [vectors[i] for i in order], [powers[i] for i in order]
        widths = [width] * len(order)
        for turn in range(rounds):
            place = turn % len(order)
            drawn = _drawn(joint, vectors[place], widths[place], rng)
            seen = joint.powers(drawn)
            costs = [cost(power, knee) for power in seen]
            best = int(np.argmin(costs))
            if costs[best] < cost(powers[place], knee):
                vectors[place], powers[place] = np.array(drawn[best]), seen[best]
            else:
                widths[place] *= _NARROWER
        width *= _NARROWED
        if number == 0 and rigid is not None:
            known = cost(joint.powers([rigid])[0], knee)
            at_noise = 0.5 * np.log((1.0 + knee) / (2.0 * knee))
            if min(cost(power, knee) for power in powers) > known - _PROMISING * (known - at_noise):
                return None
    return jnp.asarray(vectors[int(np.argmin([cost(power, knees[-1]) for power in powers]))])


def _drawn(
    joint: Joint, vector: np.ndarray, width: float, rng: np.random.Generator
) -> list[Float[Array, " q"]]:
    """As many models as are simulated side by side, in a circle of this `width` around `vector`."""
    own = f"effects.{len(joint.setting.drive.effects) - 1}."
    viscous, drawn = _viscous(joint.drive(jnp.asarray(vector))), []
    for _ in range(LANES):
        new = vector.copy()
        for i, free in enumerate(joint.layout):
            if not free.path.startswith(own):
                continue
            change = width * rng.standard_normal()
            new[i] = new[i] + change if free.parameter.transform == "log" else new[i] * np.exp(change)
        drawn.append(_balanced(joint, new, viscous))
    return drawn


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
