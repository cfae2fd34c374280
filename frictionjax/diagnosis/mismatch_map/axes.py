"""The axes along which the mismatch is mapped, and the bin of each axis that every sample lies in.

Every axis partitions the samples: no sample lies in two of its bins. Where two partitions compete for one axis (time
and distance since a reversal), both are here, and the map keeps the more informative one.
"""

import itertools

import equinox as eqx
import numpy as np
import scipy
from jaxtyping import Bool, Float, Int

from frictionjax.core.quantities import DisplayUnit, neat, one_two_five, span
from frictionjax.diagnosis.evidence.judgement import Scene
from frictionjax.diagnosis.mismatch_map.history import last_rest, since_reversal
from frictionjax.physics import Drive
from frictionjax.recordings import Plant
from frictionjax.simulation import observer_gains

_RESTS = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, np.inf)  # s
_TIMES = (0.0, 0.005, 0.02, 0.1, 0.5, np.inf)  # s since a reversal
_BENDS = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # distance since a reversal over the deflection at break-away
_SIGNIFICANT = 4.0  # standard deviations of the observer's velocity below which a velocity counts as noise


class EstimatedMotion(eqx.Module):
    """All recordings with what the observer of the base model estimates, arrays of shape `(r, n)`: `x`, `v`, `bend`
    (|z| over Fs/sigma0), `u`."""

    x: Float[np.ndarray, "r n"]
    v: Float[np.ndarray, "r n"]
    bend: Float[np.ndarray, "r n"]
    u: Float[np.ndarray, "r n"]


class Union(eqx.Module):
    """Bins of an axis that are reported as one: their `label`, the same as words after "only" (`phrase`), and the
    numbers of the `bins`."""

    label: str = eqx.field(static=True)
    phrase: str = eqx.field(static=True)
    bins: tuple[int, ...] = eqx.field(static=True)


class MapAxis(eqx.Module):
    """An axis of the map: one partition of the samples.

    **Attributes:** `name` (as in verdict.json), `labels` of the bins, `phrases` (the same as words after "only"),
    `index` of each sample's bin, shape `(r, n)`, -1 for none; `unions` of bins that are reported as one ("after rests
    longer than 0.3 s").
    """

    name: str = eqx.field(static=True)
    labels: tuple[str, ...] = eqx.field(static=True)
    phrases: tuple[str, ...] = eqx.field(static=True)
    index: Int[np.ndarray, "r n"]
    unions: tuple[Union, ...] = eqx.field(static=True, default=())

    def parts(self) -> list[tuple[str, str, tuple[int, ...]]]:
        """Label, phrase and bins of every bin and every union."""
        single = [(label, self.phrases[k], (k,)) for k, label in enumerate(self.labels)]
        return single + [(union.label, union.phrase, union.bins) for union in self.unions]

    def inside(self, bins: tuple[int, ...]) -> Bool[np.ndarray, "r n"]:
        """Which samples lie in one of the `bins`, shape `(r, n)`."""
        chosen = np.zeros(len(self.labels) + 1, bool)  # the last for samples in no bin
        chosen[list(bins)] = True
        return chosen[self.index]


def quiet_speed(drive: Drive, scene: Scene, top: float) -> Float[np.ndarray, "r 1"]:
    """Speed below which each recording of the `scene` is at rest, position units per s: a fraction of the Stribeck
    velocity of the `drive` and of the highest speed `top`, but above the noise of the observer's velocity."""
    modelled = min(0.3 * float(drive.friction.vs), 0.02 * top)
    speeds = []
    columns = (scene.bandwidth, np.asarray(scene.batch.dt), np.asarray(scene.batch.noise))
    for bandwidth, dt, noise in zip(*columns, strict=True):
        if bandwidth == 0.0:  # no observer: the motion is imposed, and `noise` is that of the force
            speeds.append(modelled)
            continue
        gains = observer_gains(float(bandwidth), float(dt))
        pole = float(np.sqrt(1.0 - gains.position))
        # From the noise of the position to the velocity of a free mass: l2 q (1 - q) / (1 - p q)^2.
        impulse = np.zeros(round(20.0 / (1.0 - pole)))
        impulse[0] = 1.0
        response = np.asarray(scipy.signal.lfilter([0.0, 1.0, -1.0], [1.0, -2.0 * pole, pole**2], impulse))
        deviation = float(gains.velocity) * float(np.linalg.norm(response)) * float(noise)
        speeds.append(max(modelled, _SIGNIFICANT * deviation))
    return np.array(speeds)[:, None]


REGIMES = (
    "stick (bristle bent below 20 % of break-away)",
    "presliding (20 to 80 %)",
    "break-away (above 80 %)",
    "slow sliding (Stribeck)",
    "sliding",
)
"""Labels of the regimes, by how far the bristle is bent and how fast the machine moves."""


def axes_of(motion: EstimatedMotion, drive: Drive, plant: Plant, scene: Scene) -> tuple[MapAxis, ...]:
    """The axes of a map, except frequency.

    **Arguments:**

    - `motion`: the recordings as the base model observes them.
    - `drive`: the base model.
    - `plant`: for units.
    - `scene`: the recordings.
    """
    valid = np.asarray(scene.batch.valid) > 0
    top = float(np.quantile(np.abs(motion.v)[valid], 0.999))
    slow = quiet_speed(drive, scene, top)
    return (
        _regime(motion, float(drive.friction.vs), slow, top),
        _direction(motion, slow),
        _velocity(motion, top, plant),
        _position(motion, valid, plant),
        _input(motion, valid, plant),
        *_since_reversal(motion, drive, slow, plant, scene),
        _dwell(motion, slow, scene),
        _time(scene),
    )


def _regime(motion: EstimatedMotion, vs: float, slow: Float[np.ndarray, "r 1"], top: float) -> MapAxis:
    speed = np.abs(motion.v)
    gross = speed > max(min(3.0 * vs, 0.3 * top), 0.0)
    moving = (speed > slow) & (motion.bend > 0.5)
    bent = np.digitize(motion.bend, (0.2, 0.8))
    index = np.where(gross, 4, np.where(moving, 3, bent))
    return MapAxis("regime", REGIMES, tuple(f"in {label.split(' (')[0]}" for label in REGIMES), index)


def _direction(motion: EstimatedMotion, slow: Float[np.ndarray, "r 1"]) -> MapAxis:
    index = np.where(motion.v > slow, 0, np.where(motion.v < -slow, 1, 2))
    labels = ("forward", "backward", "at rest")
    return MapAxis("direction", labels, ("moving forward", "moving backward", "at rest"), index)


def _velocity(motion: EstimatedMotion, top: float, plant: Plant) -> MapAxis:
    edges = top * np.array([0.0, 0.001, 0.01, 0.03, 0.1, 0.3, np.inf])
    return _along("velocity", np.abs(motion.v), edges, plant.displayed(f"{plant.position_unit}/s"), "|v|")


def _position(motion: EstimatedMotion, valid: Bool[np.ndarray, "r n"], plant: Plant) -> MapAxis:
    places = np.linspace(float(motion.x[valid].min()), float(motion.x[valid].max()), 9)
    return _along("position", motion.x, places, plant.shown_position, "x")


def _input(motion: EstimatedMotion, valid: Bool[np.ndarray, "r n"], plant: Plant) -> MapAxis:
    effort = np.quantile(np.abs(motion.u[valid]), [0.0, 0.25, 0.5, 0.75, 0.9, 1.0])
    effort[0], effort[-1] = 0.0, np.inf
    return _along("input", np.abs(motion.u), np.unique(effort), plant.shown_input, "|u|")


def _along(
    name: str,
    values: Float[np.ndarray, "r n"],
    edges: Float[np.ndarray, " k"],
    unit: str | DisplayUnit,
    symbol: str,
) -> MapAxis:
    """An axis along the `values` of a quantity with this `symbol`."""
    # The outermost bins include everything beyond their edges: the largest position itself, and samples not scored.
    index = np.clip(np.digitize(values, edges) - 1, 0, len(edges) - 2)
    inner = tuple(neat(edge, unit, edge - before) for before, edge in itertools.pairwise(edges[:-1].tolist()))
    labels = [f"{symbol} {span(low, high, unit)}" for low, high in itertools.pairwise(edges[:-1].tolist())]
    if np.isinf(edges[-1]):
        # A magnitude: from zero to infinity.
        first = f"{symbol} below {inner[0]}" if inner else f"{symbol} of any size"
        labels = [first, *labels[1:], *([f"{symbol} above {inner[-1]}"] if inner else [])]
    else:
        labels.append(f"{symbol} {span(float(edges[-2]), float(edges[-1]), unit)}")
    unions = _beyond(inner, f"{symbol} above {{}}", f"{symbol} below {{}}", "at ")
    return MapAxis(name, tuple(labels), tuple(f"at {label}" for label in labels), index, unions)


def _beyond(edges: tuple[str, ...], above: str, below: str, before: str) -> tuple[Union, ...]:
    """The unions of all bins above, and of all below, each of the `edges` between ordered bins, unless that is a single
    bin; `before` precedes the label in the phrase."""
    bins, found = tuple(range(len(edges) + 1)), []
    for k, edge in enumerate(edges):
        if k + 1 < len(edges):
            found.append(Union(above.format(edge), f"{before}{above.format(edge)}", bins[k + 1 :]))
        if k > 0:
            found.append(Union(below.format(edge), f"{before}{below.format(edge)}", bins[: k + 1]))
    return tuple(found)


def _since_reversal(
    motion: EstimatedMotion, drive: Drive, slow: Float[np.ndarray, "r 1"], plant: Plant, scene: Scene
) -> tuple[MapAxis, MapAxis]:
    dt = np.asarray(scene.batch.dt)
    since = [
        since_reversal(x, v, float(rest), float(step))
        for x, v, rest, step in zip(motion.x, motion.v, slow[:, 0], dt, strict=True)
    ]
    bend = float(drive.friction.Fs / drive.friction.sigma0)
    edges = [one_two_five(bend * size) for size in _BENDS]
    reach = max(float(np.ptp(x[:length])) for x, length in zip(motion.x, scene.batch.lengths, strict=True))
    distances = np.array([0.0, *dict.fromkeys(edge for edge in edges if edge < reach), np.inf])
    time, distance = np.stack([one[0] for one in since]), np.stack([one[1] for one in since])
    return _after(time, np.array(_TIMES), "s"), _after(distance, distances, plant.shown_position)


def _after(
    values: Float[np.ndarray, "r n"], edges: Float[np.ndarray, " k"], unit: str | DisplayUnit
) -> MapAxis:
    labels, phrases = [], []
    for low, high in itertools.pairwise(edges.tolist()):
        if low == 0.0 and np.isfinite(high):
            labels.append(f"first {neat(high, unit)} after a reversal")
            phrases.append(f"in the {labels[-1]}")
        else:
            beyond = f"more than {neat(low, unit)}" if low > 0.0 else "any time"
            labels.append(f"{span(low, high, unit) if np.isfinite(high) else beyond} after a reversal")
            phrases.append(labels[-1])
    inner = tuple(neat(edge, unit) for edge in edges[1:-1].tolist())
    index = np.digitize(values, edges[1:-1])
    unions = _beyond(inner, "more than {} after a reversal", "first {} after a reversal", "")
    unions = tuple(
        Union(union.label, f"in the {union.label}", union.bins) if union.bins[0] == 0 else union
        for union in unions
    )
    return MapAxis("since_reversal", tuple(labels), tuple(phrases), index, unions)


def _dwell(motion: EstimatedMotion, slow: Float[np.ndarray, "r 1"], scene: Scene) -> MapAxis:
    dt = np.asarray(scene.batch.dt)
    rows = [
        last_rest(v, float(rest), float(step)) for v, rest, step in zip(motion.v, slow[:, 0], dt, strict=True)
    ]
    length, resting = np.stack([row[0] for row in rows]), np.stack([row[1] for row in rows])
    index = np.digitize(length, _RESTS[1:-1])
    bins = len(_RESTS) - 1
    index = np.where(resting, bins, np.where(np.isinf(length), bins + 1, index))
    labels = ["after rests below 10 ms"]
    labels += [f"after rests of {span(low, high, 's')}" for low, high in itertools.pairwise(_RESTS[1:-1])]
    labels += [f"after rests longer than {neat(_RESTS[-2], 's')}", "at rest", "before the first rest"]
    inner = tuple(neat(edge, "s") for edge in _RESTS[1:-1])
    unions = _beyond(inner, "after rests longer than {}", "after rests shorter than {}", "")
    return MapAxis("dwell", tuple(labels), tuple(labels), index, unions)


def _time(scene: Scene) -> MapAxis:
    index = np.full(np.asarray(scene.batch.valid).shape, -1)
    labels = []
    for row, name in enumerate(scene.names):
        dt = float(scene.batch.dt[row])
        for first, last in itertools.pairwise(np.linspace(0, scene.batch.lengths[row], 4).astype(int)):
            index[row, first:last] = len(labels)
            labels.append(f"{name} from {first * dt:.3g} to {last * dt:.3g} s")
    whole = tuple(
        Union(f"recording {name}", f"in recording {name}", tuple(range(3 * row, 3 * row + 3)))
        for row, name in enumerate(scene.names)
    )
    return MapAxis("time", tuple(labels), tuple(f"in {label}" for label in labels), index, whole)
