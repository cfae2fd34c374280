"""Starting values from imposed motions and their friction forces alone.

The motion is cut into legs, from reversal to reversal. Late in a leg that slides the force is flat, and determines Fc,
sigma2 and the Stribeck bump; early in it the force reverses over the length of a bristle: -F -> F in LuGre is
F (1 - 2 exp(-sigma0 s/F)), through zero at s = ln 2 F/sigma0.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from jaxtyping import Bool, Float

from frictionjax.estimation.start.driven import StartingValues
from frictionjax.frequency import FRF, fit_sk
from frictionjax.physics import Drive, LuGre
from frictionjax.recordings import Recording

_SMOOTH = 9  # samples of the moving average that the position is differentiated after, at most
_LEAST_TRAVEL = 0.02  # of the largest travel: shorter legs are noise of the position
_LATE = 0.6  # part of a leg's travel after which its force may be flat
_FLAT = 0.15  # of a leg's swing: a force that rises less over the late part slides
_SPEEDS = np.geomspace(0.02, 1.0, 12)  # Stribeck velocities that are tried, over the largest speed
_BUMP = 0.05  # of Coulomb friction: a Stribeck bump below it may be noise
_BAND = (1.0, 300.0)  # Hz of a response in stick, at most


class _Leg(NamedTuple):
    """Travel `s` since the last reversal, speed and force in the direction of motion of one leg, shape `(n,)`."""

    s: Float[np.ndarray, " n"]
    speed: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    sign: float

    @property
    def late(self) -> Bool[np.ndarray, " n"]:
        """Samples beyond `_LATE` of the travel, while the motion goes on."""
        return (self.s > _LATE * self.s[-1]) & (self.speed > 0.2 * np.max(self.speed))

    @property
    def rise(self) -> float:
        """Rise of the force over the late part, as a part of the swing over the whole leg."""
        late = self.late
        if np.sum(late) < 4:
            return 1.0
        swing = float(np.max(self.force) - np.min(self.force))
        slope = np.polyfit(self.s[late], self.force[late], 1)[0]
        return float(slope * (1.0 - _LATE) * self.s[-1] / max(swing, 1e-300))


class _Plateau(NamedTuple):
    """|F - load| = Fc + bump exp(-(v/vs)^2) + sigma2 |v| of the legs that slide."""

    Fc: float
    bump: float
    vs: float
    sigma2: float
    load: float


def starting_values_imposed(
    recordings: tuple[Recording, ...],
    *,
    inertia: float | None = None,
    responses: tuple[FRF, ...] = (),
    motor_constant: float = 1.0,
) -> StartingValues:
    """Starting values for the base fit of imposed motions.

    **Arguments:**

    - `recordings`: motion-driven recordings with their force.
    - `inertia`: known inertia, or None: imposed motions do not determine it, and without `responses` it is 1.
    - `responses`: frequency responses of the same machine in stick; the first usable one gives J.
    - `motor_constant`: force per input unit, of the responses.

    **Returns:**

    A `StartingValues`; `presliding_seen`: whether any leg is resolved before it slides.
    """
    legs = [leg for recording in recordings for leg in _legs(recording)]
    notes = []
    J, stiff = _of_response(responses, motor_constant)
    J = inertia if inertia is not None else J
    sliding = [leg for leg in legs if leg.rise < _FLAT and np.sum(leg.late) >= 4]
    top = max((float(np.max(leg.speed)) for leg in legs), default=1.0) or 1.0
    forces = [np.asarray(r.force, dtype=float) for r in recordings]
    largest = max(float(np.max(np.abs(force - np.mean(force)))) for force in forces)
    if sliding:
        plateaus = _plateaus(sliding, top)
    else:
        notes.append(
            "No motion slides: friction is bounded from below only, and its velocity dependence is unknown."
        )
        # Slower than the Stribeck velocity, as far as is known: static friction is the level then.
        plateaus = [
            _Plateau(margin * largest, 0.2 * margin * largest, 10.0 * top, 0.0, 0.0) for margin in (1.0, 2.5)
        ]
    found = _stiffnesses(legs, sliding, plateaus[0])
    if not found and stiff is None:
        notes.append(
            "No motion is sampled finely enough after its reversals to determine the bristles' stiffness."
        )
        travel = max((float(leg.s[-1]) for leg in legs), default=float(max(np.ptp(r.x) for r in recordings)))
        found = [plateaus[0].Fc / (part * max(travel, 1e-300)) for part in (1e-2, 1e-3)]
    if stiff is not None:
        found = [stiff, *found[:1]]
    drives = []
    for stiffness in found:
        for one in plateaus:
            # A hundredth of Coulomb friction at top speed is as good as zero, and positive.
            sigma2 = max(one.sigma2, 0.01 * one.Fc / top)
            Fs = one.Fc + float(np.clip(one.bump, 0.1 * one.Fc, 1.5 * one.Fc))
            # Over a bristle's own time at top speed its damping force is a twentieth of its spring force.
            sigma1 = max(0.05 * one.Fc / top, 0.1 * sigma2)
            law = LuGre(float(stiffness), sigma1, sigma2, one.Fc, Fs, one.vs)
            drives.append(Drive(1.0 if J is None else J, law))
    return StartingValues(tuple(drives), tuple(notes), bool(found))


def _smoothed(values: Float[np.ndarray, " n"], width: int) -> Float[np.ndarray, " n"]:
    """Moving average over `width` (odd) samples, with the first and last value repeated outside."""
    if width <= 1:
        return np.asarray(values, dtype=float)
    padded = np.pad(values, width // 2, mode="edge")
    return np.convolve(padded, np.full(width, 1.0 / width), mode="valid")


def _turns(x: Float[np.ndarray, " n"], least: float) -> list[int]:
    """Samples at which `x` reverses by more than `least`, and the first and last sample."""
    found, best, direction = [0], 0, 0.0
    for i, value in enumerate(x):
        if direction == 0.0:
            if abs(value - x[0]) > least:
                direction, best = float(np.sign(value - x[0])), i
        elif direction * (value - x[best]) >= 0.0:
            best = i
        elif direction * (x[best] - value) > least:
            found.append(best)
            direction, best = -direction, i
    return [*found, x.size - 1]


def _legs(recording: Recording) -> list[_Leg]:
    raw = np.asarray(recording.x, dtype=float)
    if recording.force is None or not np.ptp(raw) > 0.0:
        return []
    least = _LEAST_TRAVEL * float(np.ptp(raw))
    # A moving average must stay short against the legs.
    legs = max(len(_turns(raw, least)) - 1, 1)
    width = int(np.clip(raw.size / legs / 20.0, 1, _SMOOTH)) // 2 * 2 + 1
    x = _smoothed(raw, width)
    v = np.gradient(x) * recording.sample_rate
    force = _smoothed(np.asarray(recording.force, dtype=float), min(width, 3))
    turns = _turns(x, least)
    found = []
    for first, last in pairwise(turns):
        if last - first < 6:
            continue
        sign = float(np.sign(x[last] - x[first])) or 1.0
        inside = slice(first, last + 1)
        # A dwell at the reversal belongs to neither leg; where it wavers, the travel does not decrease.
        s = np.maximum.accumulate(sign * (x[inside] - x[first]))
        if s[-1] > least:
            found.append(_Leg(s, np.maximum(sign * v[inside], 0.0), sign * force[inside], sign))
    return found


def _plateaus(legs: list[_Leg], top: float) -> list[_Plateau]:
    """Non-negative least squares on the late parts for each Stribeck velocity that is tried; the likeliest two."""
    speed = np.concatenate([leg.speed[leg.late] for leg in legs])
    force = np.concatenate([leg.force[leg.late] for leg in legs])
    sign = np.concatenate([np.full(int(np.sum(leg.late)), leg.sign) for leg in legs])
    base = float(np.mean(force))
    if not base > 0.0:
        base = float(np.max(np.abs(force)))
    slow, fast = np.quantile(speed, [0.1, 0.9])
    if fast < 1.5 * max(slow, 1e-300):
        # At one speed no dependence on it can be found.
        Fc = _level(force, sign)[0]
        return [
            _Plateau(Fc, bump * Fc, part * top, 0.0, _level(force, sign)[1])
            for bump, part in ((0.1, 0.1), (0.3, 0.5))
        ]
    found = []
    for part in _SPEEDS:
        bump = np.exp(-((speed / (part * top)) ** 2))
        columns = np.stack([np.ones_like(speed), bump, speed / top, sign, -sign], axis=1)
        solution, residual = scipy.optimize.nnls(columns, force)
        found.append((residual, part * top, solution))
    found.sort(key=lambda one: one[0])
    plateaus = []
    for _, vs, (Fc, bump, viscous, up, down) in found[:1]:
        if bump < _BUMP * base:
            vs, bump = 0.05 * top, 0.1 * base
        plateaus.append(_Plateau(max(Fc, 0.2 * base), bump, vs, viscous / top, up - down))
    first = plateaus[0]
    return [first, _Plateau(first.Fc, first.bump, 0.3 * first.vs, first.sigma2, first.load)]


def _level(force: Float[np.ndarray, " n"], sign: Float[np.ndarray, " n"]) -> tuple[float, float]:
    """Half the sum and half the difference of the mean forces in both directions."""
    means = [float(np.mean(force[sign * side > 0.0])) for side in (1.0, -1.0) if np.any(sign * side > 0.0)]
    if len(means) < 2:
        return abs(means[0]), 0.0
    return abs(0.5 * (means[0] + means[1])), 0.5 * (means[0] - means[1])


def _stiffnesses(legs: list[_Leg], sliding: list[_Leg], level: _Plateau) -> list[float]:
    """Alternatives for sigma0, most credible first; none where no leg is resolved."""
    halves, slopes = [], []
    for leg in sliding:
        first, end = leg.force[0], float(np.mean(leg.force[leg.late]))
        middle = 0.5 * (first + end)
        # Only after a full reversal does half the swing give the length of a bristle.
        at = int(np.argmax(leg.force > middle))
        if end - first < 1.2 * level.Fc or at < 1:
            continue
        rise = leg.force[at] - leg.force[at - 1]
        share = np.clip((middle - leg.force[at - 1]) / rise, 0.0, 1.0) if rise > 0.0 else 1.0
        travel = leg.s[at - 1] + share * (leg.s[at] - leg.s[at - 1])
        if travel > 0.0:
            halves.append(np.log(2.0) * 0.5 * (end - first) / travel)
    for leg in legs:
        early = leg.s <= max(0.15 * leg.s[-1], leg.s[min(4, leg.s.size - 1)])
        if leg.rise < _FLAT or np.sum(early) < 4 or not np.ptp(leg.s[early]) > 0.0:
            continue
        # The tangent after a full reversal is 2 sigma0, at a virgin start sigma0; curves bend down from there.
        slopes.append(0.87 * np.polyfit(leg.s[early], leg.force[early], 1)[0])
    found = [float(np.median(some)) for some in (halves, slopes) if some and np.median(some) > 0.0]
    if len(found) == 2 and 0.7 < found[1] / found[0] < 1.4:
        found = found[:1]
    return [found[0], *found[1:], 0.5 * found[0], 2.0 * found[0]] if found else []


def _of_response(responses: tuple[FRF, ...], motor_constant: float) -> tuple[float | None, float | None]:
    """Inertia and stiffness from the first of the `responses` that determines both."""
    for frf in responses:
        top = min(_BAND[1], 0.4 * float(frf.sample_rate))
        found = fit_sk(frf, band=(_BAND[0], top), motor_constant=motor_constant)
        if found.J.value > 0.0 and found.stiffness.value > 0.0:
            return found.J.value, found.stiffness.value
    return None, None
