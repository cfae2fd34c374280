"""Which regimes of friction a recording visits, found without a model.

A moment is *at rest* when the position stays inside its noise for at least `REST_TIME`. Motion is *presliding* as
long as the travel since the last reversal or rest is no more than the gross travel, and *sliding* beyond it. The
gross travel separates the two populations of travels (between reversals) that a recording through break-away shows,
two decades or more apart. A recording of one population is judged by size alone: presliding is micrometres that a
sensor resolves into some thousands of steps at most, and no contact bends by a tenth of a radian or a centimetre,
which is all that shows that a machine with a coarse sensor slides. With an imposed motion the measured force decides
instead: sliding begins, after a reversal, when the force has come near its level in that direction.
"""

import itertools

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from frictionjax.recordings.units import parse_unit

REST_TIME = 0.1  # s
_BLOCK = 0.02  # s, the window in which speed is judged
_DECADES = 2.0  # between the medians of the two populations of travels
_RESOLVED = 20.0  # smallest travel over the noise that counts for the populations
_LARGE = 2e4  # range of x over its noise beyond which a recording of one population is called sliding
_FURTHEST = {"rad": 0.1, "m": 0.01}  # range of x in SI units, beyond which it is called sliding in any case
_LEVEL = 0.8  # of the sliding level of a measured force, where sliding is taken to begin


class Regimes(eqx.Module):
    """What a recording visits.

    **Attributes:**

    - `rest`, `presliding`, `sliding`: parts of the time; their sum is 1.
    - `rests`: lengths of the rests, s, in order.
    - `reversals`: changes of direction between two stretches of sliding.
    - `speed`: smallest and largest speed in sliding (5th and 95th percentile), position units per s; None without
      sliding.
    - `gross_travel`: travel since a reversal beyond which motion counts as sliding, position units; infinite when
      nothing slides, None when the measured force decided.
    - `evidence`: `"two travels"`, `"size"`, `"given"` or `"force"`: what separated presliding from sliding.
    """

    rest: float = eqx.field(static=True)
    presliding: float = eqx.field(static=True)
    sliding: float = eqx.field(static=True)
    rests: tuple[float, ...] = eqx.field(static=True)
    reversals: int = eqx.field(static=True)
    speed: tuple[float, float] | None = eqx.field(static=True)
    gross_travel: float | None = eqx.field(static=True)
    evidence: str = eqx.field(static=True)


def find_regimes(
    x: Float[np.ndarray, " n"],
    sample_rate: float,
    resolution: float,
    *,
    force: Float[np.ndarray, " n"] | None = None,
    gross_travel: float | None = None,
    unit: str = "",
) -> Regimes:
    """Divide a recording into rest, presliding and sliding.

    **Arguments:**

    - `x`: position, shape `(n,)`.
    - `sample_rate`: Hz.
    - `resolution`: standard deviation of the noise of `x`, quantisation included, in position units.
    - `force`: measured friction force under an imposed motion, shape `(n,)`; decides when given.
    - `gross_travel`: travel since a reversal that counts as sliding, position units; found from the data when None.
    - `unit`: of the position, where it is known.

    **Returns:** the `Regimes`.
    """
    block = min(max(4, round(_BLOCK * sample_rate)), max(1, x.size))
    count = x.size // block
    still = np.ptp(x[: count * block].reshape(count, block), axis=1) <= 7.0 * resolution
    rests = [run for run in runs(still) if (run[1] - run[0]) * block >= REST_TIME * sample_rate]
    resting = np.zeros(x.size, dtype=bool)
    for begin, end in rests:
        resting[begin * block : end * block] = True
    turns = turning_points(x, 8.0 * resolution)
    travels = np.diff(x[turns])
    if force is not None:
        slides, evidence = _at_level(x, force, turns), "force"
        gross_travel = None
    else:
        evidence = "given"
        if gross_travel is None:
            gross_travel, evidence = _gross_travel(np.abs(travels), float(np.ptp(x)), resolution, unit)
        slides = _far(
            x, np.union1d(turns, np.flatnonzero(np.diff(resting.astype(np.int8)) == -1)), gross_travel
        )
    slides &= ~resting
    long = np.add.reduceat(slides, turns[:-1]) > 0 if travels.size else np.zeros(0, dtype=bool)
    speed = np.abs(_velocity(x, sample_rate)[slides])
    return Regimes(
        rest=float(resting.mean()),
        presliding=float(np.mean(~resting & ~slides)),
        sliding=float(slides.mean()),
        rests=tuple(float((end - begin) * block / sample_rate) for begin, end in rests),
        reversals=int(np.count_nonzero(np.diff(np.sign(travels[long])))),
        speed=(float(np.quantile(speed, 0.05)), float(np.quantile(speed, 0.95))) if speed.size else None,
        gross_travel=gross_travel,
        evidence=evidence,
    )


def turning_points(x: Float[np.ndarray, " n"], height: float) -> Int[np.ndarray, " m"]:
    """Where the position turns back by more than `height`, first and last sample included.

    **Arguments:**

    - `x`: position, shape `(n,)`, averaged over five samples before the search.
    - `height`: how far it must retreat from an extreme for the extreme to count, position units.

    **Returns:** indices into `x`, increasing, shape `(m,)` with `m >= 2`.
    """
    smooth = np.convolve(np.pad(x, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    # Only local extremes can be turning points; the loop below visits these alone.
    slope = np.sign(np.diff(smooth))
    candidates = np.flatnonzero(slope[1:] != slope[:-1]) + 1
    turns, top, bottom, direction = [0], 0, 0, 0
    values = smooth.tolist()
    for k in [*candidates.tolist(), x.size - 1]:
        if values[k] > values[top]:
            top = k
        if values[k] < values[bottom]:
            bottom = k
        if direction >= 0 and values[top] - values[k] > height:
            turn, direction = top, -1
        elif direction <= 0 and values[k] - values[bottom] > height:
            turn, direction = bottom, 1
        else:
            continue
        top, bottom = k, k
        if len(turns) > 1 or abs(values[turn] - values[0]) > height:  # the first direction is no turn
            turns.append(turn)
    return np.unique([*turns, x.size - 1])


def _gross_travel(
    travels: Float[np.ndarray, " m"], extent: float, resolution: float, unit: str
) -> tuple[float, str]:
    """The travel that separates presliding from sliding, and the evidence for it."""
    logs = np.sort(np.log10(travels[travels > _RESOLVED * resolution]))
    if logs.size >= 2:
        # Otsu's threshold: the split with the least variance inside the two groups.
        sizes = np.arange(1, logs.size)
        left, right = np.cumsum(logs)[:-1] / sizes, np.cumsum(logs[::-1])[-2::-1] / sizes[::-1]
        k = int(np.argmax(sizes * sizes[::-1] * (right - left) ** 2))
        if np.median(logs[k + 1 :]) - np.median(logs[: k + 1]) > _DECADES:
            return float(10.0 ** (0.5 * (logs[k] + logs[k + 1]))), "two travels"
    slides = extent > _LARGE * resolution or extent > furthest_presliding(unit)
    return (8.0 * resolution if slides else float("inf")), "size"


def furthest_presliding(unit: str) -> float:
    """Range of a position with this `unit` that is no presliding, in that unit; infinite for a unit of no angle and no
    length."""
    known = parse_unit(unit)
    return float("inf") if known is None else _FURTHEST.get(known.si, float("inf")) / known.factor


def _far(
    x: Float[np.ndarray, " n"], anchors: Int[np.ndarray, " m"], gross_travel: float
) -> Bool[np.ndarray, " n"]:
    """Samples further than the gross travel from the last anchor before them."""
    last = np.searchsorted(anchors, np.arange(x.size), side="right") - 1
    return np.abs(x - x[anchors[np.maximum(last, 0)]]) > gross_travel


def _at_level(
    x: Float[np.ndarray, " n"], force: Float[np.ndarray, " n"], turns: Int[np.ndarray, " m"]
) -> Bool[np.ndarray, " n"]:
    """Samples after the force, since the last reversal, has come near its level in the direction of motion."""
    spans = list(itertools.pairwise(turns.tolist()))
    signs = [float(np.sign(x[end] - x[begin])) for begin, end in spans]
    ends = np.array([np.median(force[end - max(1, (end - begin) // 3) : end]) for begin, end in spans])
    # Friction counted along or against the motion: the sign that most of the travel agrees with.
    weight = np.array([abs(x[end] - x[begin]) for begin, end in spans])
    sense = float(np.sign(np.sum(weight * ends * signs))) or 1.0
    slides = np.zeros(x.size, dtype=bool)
    for sign in (-1.0, 1.0):
        mine = np.array(signs) == sign
        if not mine.any():
            continue
        level = float(np.median(sign * sense * ends[mine]))
        for (begin, end), chosen in zip(spans, mine, strict=True):
            reached = (
                np.flatnonzero(sign * sense * force[begin:end] >= _LEVEL * level)
                if chosen and level > 0
                else []
            )
            if len(reached):
                slides[begin + reached[0] : end] = True
    return slides


def _velocity(x: Float[np.ndarray, " n"], sample_rate: float) -> Float[np.ndarray, " n"]:
    """Central difference over about 4 ms, position units per s."""
    half = min(max(1, round(2e-3 * sample_rate)), (x.size - 1) // 2)
    if half < 1:
        return np.zeros_like(x)
    inner = (x[2 * half :] - x[: -2 * half]) * (sample_rate / (2 * half))
    return np.pad(inner, half, mode="edge")


def runs(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """First index of every stretch of True in the `flags`, and the index after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
