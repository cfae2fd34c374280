"""Locate: where the base model fails, before anything is named.

Excess power of the standardised innovations over the noise floor, in bins of regime, direction, velocity, position,
input, time since a reversal, time and frequency. The shares of one axis add to 1.
"""

import itertools

import equinox as eqx
import numpy as np

from frictionjax.diagnosis.evaluate import View
from frictionjax.diagnosis.judge import Scene
from frictionjax.diagnosis.verdict import MismatchBin
from frictionjax.physics import Drive
from frictionjax.recordings import Plant

_LEAST = 200  # samples: a bin with fewer is left out


class Motion(eqx.Module):
    """The base model's own view of all recordings, shape `(r, n)`: `x`, `v`, bend (|z| over Fs/sigma0), `u`."""

    x: np.ndarray
    v: np.ndarray
    bend: np.ndarray
    u: np.ndarray


def _edges(values: np.ndarray, edges: np.ndarray, unit: str, symbol: str) -> dict[str, np.ndarray]:
    bins = {}
    for low, high in itertools.pairwise(edges):
        if np.isinf(high):
            label = f"{symbol} above {low:.3g} {unit}"
        elif low == 0.0:
            label = f"{symbol} below {high:.3g} {unit}"
        else:
            label = f"{symbol} {low:.3g} to {high:.3g} {unit}"
        bins[label] = (values >= low) & (values < high)
    return bins


def _since_reversal(v: np.ndarray, slow: float, dt: np.ndarray) -> np.ndarray:
    """Time since the velocity last changed its sign (beyond `slow` on the new side), s, shape `(r, n)`."""
    result = np.full(v.shape, np.inf)
    for row in range(v.shape[0]):
        moving = np.flatnonzero(np.abs(v[row]) > slow)
        if moving.size < 2:
            continue
        turns = moving[1:][np.diff(np.sign(v[row][moving])) != 0]
        last = np.maximum.accumulate(
            np.where(np.isin(np.arange(v.shape[1]), turns), np.arange(v.shape[1]), -1)
        )
        result[row] = np.where(last >= 0, (np.arange(v.shape[1]) - last) * dt[row], np.inf)
    return result


def axes_of(motion: Motion, drive: Drive, plant: Plant, scene: Scene) -> dict[str, dict[str, np.ndarray]]:
    """Axis -> label of bin -> mask of shape `(r, n)`.

    **Arguments:**

    - `motion`: the base model's view of the recordings.
    - `drive`: the base model.
    - `plant`: for units.
    - `scene`: the recordings.
    """
    speed, vs = np.abs(motion.v), float(drive.friction.vs)
    dt = np.asarray(scene.batch.dt)
    valid = np.asarray(scene.batch.valid) > 0
    top = float(np.quantile(speed[valid], 0.999))
    position, velocity = plant.position_unit, f"{plant.position_unit}/s"
    slow = min(0.3 * vs, 0.02 * top)
    gross = speed > min(3.0 * vs, 0.3 * top)
    moving = (speed > slow) & (motion.bend > 0.5)
    regime = {
        "stick (bristle bent below 20 % of break-away)": ~moving & ~gross & (motion.bend < 0.2),
        "presliding (20 to 80 %)": ~moving & ~gross & (motion.bend >= 0.2) & (motion.bend < 0.8),
        "break-away (above 80 %)": ~moving & ~gross & (motion.bend >= 0.8),
        "slow sliding (Stribeck)": moving & ~gross,
        "sliding": gross,
    }
    since = _since_reversal(motion.v, slow, dt)
    low, high = float(motion.x[valid].min()), float(motion.x[valid].max())
    places = np.linspace(low, high, 9)
    effort = np.quantile(np.abs(motion.u[valid]), [0.0, 0.25, 0.5, 0.75, 0.9, 1.0])
    effort[0], effort[-1] = 0.0, np.inf
    time: dict[str, np.ndarray] = {}
    for row, name in enumerate(scene.names):
        thirds = np.linspace(0, scene.batch.lengths[row], 4).astype(int)
        for first, last in itertools.pairwise(thirds):
            mask = np.zeros(valid.shape, bool)
            mask[row, first:last] = True
            time[f"{name}, {first * dt[row]:.3g} to {last * dt[row]:.3g} s"] = mask
    speeds = top * np.array([0.0, 0.001, 0.01, 0.03, 0.1, 0.3, np.inf])
    return {
        "regime": regime,
        "direction": {"forward": motion.v > slow, "backward": motion.v < -slow, "at rest": speed <= slow},
        "velocity": _edges(speed, speeds, velocity, "|v|"),
        "position": {
            f"x {a:.3g} to {b:.3g} {position}": (motion.x >= a) & (motion.x <= b)
            for a, b in itertools.pairwise(places)
        },
        "input": _edges(np.abs(motion.u), np.unique(effort), plant.input_unit, "|u|"),
        "since_reversal": {
            "first 5 ms after a reversal": since < 0.005,
            "5 to 20 ms after a reversal": (since >= 0.005) & (since < 0.02),
            "20 to 100 ms after a reversal": (since >= 0.02) & (since < 0.1),
            "0.1 to 0.5 s after a reversal": (since >= 0.1) & (since < 0.5),
            "more than 0.5 s after a reversal": since >= 0.5,
        },
        "time": time,
    }


def mismatch_map(
    base: View, extended: View, axes: dict[str, dict[str, np.ndarray]], scene: Scene
) -> tuple[MismatchBin, ...]:
    """The map over all recordings: `excess` is power over the floor, `share` the bin's part of the excess.

    **Arguments:**

    - `base`, `extended`: the two models' views.
    - `axes`: from `axes_of`.
    - `scene`: the recordings.
    """
    valid = np.asarray(scene.batch.valid) > 0
    power = {
        "base": np.nan_to_num(base.e**2),
        "extended": np.nan_to_num(extended.e**2),
    }
    bins: list[MismatchBin] = []
    for axis, masks in axes.items():
        rows = []
        for label, mask in masks.items():
            inside = mask & valid
            count = int(inside.sum())
            if count >= _LEAST:
                level = float(power["base"][inside].mean())
                rows.append((label, level, float(power["extended"][inside].mean()), count))
        bins += _shares(axis, rows)
    return tuple(bins + _shares("frequency", _frequency_rows(base, extended, scene)))


def _shares(axis: str, rows: list[tuple[str, float, float, int]]) -> list[MismatchBin]:
    extra = np.array([max(level - 1.0, 0.0) * count for _, level, _, count in rows])
    total = float(extra.sum())
    shares = extra / total if total > 0 else np.full(len(rows), 1.0 / max(len(rows), 1))
    return [
        MismatchBin(axis, label, float(share), level, after, count)
        for (label, level, after, count), share in zip(rows, shares, strict=True)
    ]


def _frequency_rows(base: View, extended: View, scene: Scene) -> list[tuple[str, float, float, int]]:
    """Spectrum of the innovations over that of noise seen by the observer, |(1 - q)/(1 - p q)|^4, in bands."""
    edges = np.array([0.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, np.inf])
    sums = np.zeros((len(edges) - 1, 3))
    for row, length in enumerate(scene.batch.lengths):
        dt = float(scene.batch.dt[row])
        pole = np.exp(-2.0 * np.pi * scene.bandwidth * dt)
        frequency = np.fft.rfftfreq(length, dt)[1:]
        q = np.exp(-2j * np.pi * frequency * dt)
        null = np.abs((1.0 - q) / (1.0 - pole * q)) ** 4
        null = null / null.mean()  # the innovations are standardised
        # The observer leaves next to nothing at low frequencies: a hundredth of the mean is added on both sides, so
        # that rounding and leakage are not told as an excess.
        ground = 0.01
        null = null + ground
        band = np.digitize(frequency, edges) - 1
        window = np.hanning(length) * np.sqrt(8.0 / 3.0)
        for column, view in enumerate((base, extended)):
            seen = window * np.nan_to_num(view.e[row, :length])
            spectrum = np.abs(np.fft.rfft(seen)[1:]) ** 2 / length + ground
            sums[:, column] += np.bincount(band, spectrum, minlength=len(edges) - 1)
        sums[:, 2] += np.bincount(band, null, minlength=len(edges) - 1)
    rows = []
    for (low, high), (before, after, null) in zip(itertools.pairwise(edges), sums, strict=True):
        if null > 0:
            label = f"{low:.3g} to {high:.3g} Hz" if np.isfinite(high) else f"above {low:.3g} Hz"
            rows.append((label, float(before / null), float(after / null), max(int(null), 1)))
    return rows


def strongest(bins: tuple[MismatchBin, ...], axis: str) -> MismatchBin | None:
    """The bin of `axis` that stands out most: the one with the largest share times log excess."""
    return max((b for b in bins if b.axis == axis and b.excess > 1.2), key=_prominence, default=None)


def _prominence(b: MismatchBin) -> float:
    return b.share * float(np.log(b.excess))


def where_words(bins: tuple[MismatchBin, ...]) -> str:
    """Where the mismatch is, in plain words, from the strongest bins of regime, direction and one more axis."""
    parts = []
    regimes = [b for b in bins if b.axis == "regime" and b.excess > 1.2]
    peak = max(map(_prominence, regimes), default=0.0)
    # Two regimes that stand out about as much are both told, the larger share first.
    for regime in sorted(regimes, key=lambda b: -b.share):
        if _prominence(regime) > 0.7 * peak:
            parts.append(
                f"{regime.bin} ({100 * regime.share:.0f} % of the excess, {_times(regime.excess)} the expected power)"
            )
    direction = strongest(bins, "direction")
    if direction is not None and direction.share > 0.75 and direction.bin != "at rest":
        parts.append(f"moving {direction.bin} ({100 * direction.share:.0f} %)")
    others = [b for b in (strongest(bins, a) for a in ("since_reversal", "position", "input")) if b]
    sharp = [b for b in others if b.share > 0.6]
    if sharp:
        most = max(sharp, key=lambda b: b.excess)
        parts.append(f"{most.bin} ({100 * most.share:.0f} %)")
    return ", ".join(parts) if parts else "nowhere above the noise"


def _times(factor: float) -> str:
    if factor >= 1000.0:
        return "over 1000 times"
    return f"{factor:.0f} times" if factor >= 10.0 else f"{factor:.1f} times"
