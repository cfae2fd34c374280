"""A force that may be anything of what is known at each instant: the columns that it is a sum of.

Each group of columns is piecewise linear in one variable, zero at none of them: roofs over knots. Friction acts against
the motion, so that most variables come with the direction.
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.mismatch_map.axes import quiet_speed
from frictionjax.diagnosis.mismatch_map.history import last_rest, since_reversal
from frictionjax.physics import Drive

_PLACES, _SPEEDS, _BENT, _DISTANCES, _RESTS, _INPUTS, _TIMES = 16, 13, 11, 9, 6, 11, 6  # knots
_SHORTEST_REST, _LONGEST_REST = 0.01, 10.0  # s
_BENDS = (0.03, 300.0)  # distances since a reversal over the deflection at break-away


class RegressorGroup(eqx.Module):
    """The columns of one variable in the regression.

    **Attributes:** `variable` (in words), `columns` (shape `(k, r, n)`, of magnitude one).
    """

    variable: str = eqx.field(static=True)
    columns: Float[np.ndarray, "k r n"]


def free_force(
    x: Float[np.ndarray, "r n"],
    v: Float[np.ndarray, "r n"],
    z: Float[np.ndarray, "r n"],
    u: Float[np.ndarray, "r n"],
    drive: Drive,
    scene: Scene,
    since: Float[np.ndarray, " r"],
) -> tuple[RegressorGroup, ...]:
    """The columns along all recordings.

    **Arguments:**

    - `x`, `v`, `z`: position, velocity and deflection of the bristle as the model observes them.
    - `u`: recorded input.
    - `drive`: the model; its friction gives scales.
    - `scene`: the recordings.
    - `since`: s since power-on of the first sample of each.
    """
    inside, dt = np.asarray(scene.batch.valid) > 0.0, np.asarray(scene.batch.dt)
    top = float(np.quantile(np.abs(v)[inside], 0.999))
    slow = quiet_speed(drive, scene, top)
    direction = np.tanh(v / slow)
    past = [
        (
            since_reversal(*row[:2], float(row[2]), float(row[3])),
            last_rest(row[1], float(row[2]), float(row[3])),
        )
        for row in zip(x, v, slow[:, 0], dt, strict=True)
    ]
    bend = float(drive.friction.Fs / drive.friction.sigma0)
    distance = np.stack([np.minimum(reversal[1], 2.0 * _BENDS[1] * bend) for reversal, _ in past])
    rest = np.stack([np.where(np.isinf(own[0]), _SHORTEST_REST, own[0]) for _, own in past])
    clock = since[:, None] + np.arange(x.shape[1]) * dt[:, None]
    place = _roofs(x, np.linspace(*_span(x, inside), _PLACES))
    bends = np.geomspace(_BENDS[0] * bend, _BENDS[1] * bend, _DISTANCES)
    rests = np.geomspace(_SHORTEST_REST, _LONGEST_REST, _RESTS)
    # Knots are dense where friction falls: even steps of the inverse hyperbolic sine, in all recordings the same.
    slowest = float(np.min(slow))
    speed, fastest = np.arcsinh(v / slowest), float(np.arcsinh(top / slowest))
    groups = (
        RegressorGroup("velocity", _roofs(speed, np.linspace(-fastest, fastest, _SPEEDS))),
        RegressorGroup("deflection of the bristle", _roofs(z / bend, np.linspace(-1.0, 1.0, _BENT))),
        RegressorGroup("position", place),
        RegressorGroup("position and direction", place * direction),
        RegressorGroup(
            "distance since a reversal",
            _roofs(np.log(np.maximum(distance, bends[0])), np.log(bends)) * direction,
        ),
        RegressorGroup(
            "the last rest", _roofs(np.log(np.maximum(rest, rests[0])), np.log(rests)) * direction
        ),
        RegressorGroup("input", _roofs(u, np.linspace(*_span(u, inside), _INPUTS))),
        RegressorGroup(
            "size of the input and direction",
            _roofs(np.abs(u), np.linspace(*_span(np.abs(u), inside), _INPUTS)) * direction,
        ),
        RegressorGroup("time", _roofs(clock, np.linspace(*_span(clock, inside), _TIMES)) * direction),
    )
    return tuple(RegressorGroup(group.variable, _used(group.columns, inside)) for group in groups)


def _span(values: Float[np.ndarray, "r n"], inside: Bool[np.ndarray, "r n"]) -> tuple[float, float]:
    low, high = float(values[inside].min()), float(values[inside].max())
    return low, high if high > low else low + 1.0


def _roofs(values: Float[np.ndarray, "r n"], knots: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k r n"]:
    """For each of evenly spaced `knots` a roof over it, one there and zero at its neighbours; constant beyond."""
    step = knots[1] - knots[0]
    place = np.clip((values - knots[0]) / step, 0.0, len(knots) - 1.0)
    return np.stack([np.maximum(0.0, 1.0 - np.abs(place - k)) for k in range(len(knots))])


def _used(columns: Float[np.ndarray, "k r n"], inside: Bool[np.ndarray, "r n"]) -> Float[np.ndarray, "_ r n"]:
    """Those of the `columns` that are not zero throughout, and zero where nothing was recorded."""
    columns = columns * inside
    return columns[np.any(columns != 0.0, axis=(1, 2))]


def together(groups: Sequence[RegressorGroup]) -> Float[np.ndarray, "k r n"]:
    """The columns of all `groups`."""
    return np.concatenate([group.columns for group in groups])
